//! Figures over the samples of the horizon.

use figures::{Axis, Curve, Figure, Point, SERIES_ALLOWED};
use wire::{GroupSummary, PredictorInfo, Report, SamplingInfo};

use super::{colour_of, point};

/// RMSE over the sampler's steps on the scenarios of one group. Each curve has predictors that
/// differ only in the steps.
pub fn sampler_steps_figure(report: &Report, group: &GroupSummary) -> Figure {
    let series = curves(report, |info, sampling| {
        let summary = group.rmse_deg.iter().find(|summary| summary.predictor == info.name)?;
        Some(point(f64::from(sampling.steps), summary.interval))
    });
    Figure {
        title: format!("Prediction error over sampler steps, {}", group.name),
        x: Axis::log(STEPS),
        y: Axis::log("RMSE").in_unit("deg"),
        series,
        bands: Vec::new(),
    }
}

/// Median latency of one prediction over the sampler's steps, up to its 99th percentile.
pub fn latency_figure(report: &Report) -> Figure {
    let series = curves(report, |info, sampling| {
        let latency = info.latency.as_ref()?;
        let (median, p99) = (latency.median_ms, latency.p99_ms);
        Some(Point::with_interval(f64::from(sampling.steps), median, median, p99))
    });
    Figure {
        title: "Latency over sampler steps".to_owned(),
        x: Axis::log(STEPS),
        y: Axis::log("Latency of one prediction, median to p99").in_unit("ms"),
        series,
        bands: Vec::new(),
    }
}

const STEPS: &str = "Steps of the sampler";

fn curves(
    report: &Report,
    at: impl Fn(&PredictorInfo, &SamplingInfo) -> Option<Point>,
) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for info in &report.predictors {
        let Some(sampling) = &info.sampling else { continue };
        let Some(point) = at(info, sampling) else { continue };
        match curves.iter_mut().find(|curve| curve.name == sampling.curve) {
            Some(curve) => curve.points.push(point),
            None => {
                let colour = colour_of(&report.predictors, &sampling.curve);
                let curve = Curve::line(&sampling.curve, vec![point]).with_markers();
                curves.push(curve.coloured(colour));
            }
        }
    }
    curves.truncate(SERIES_ALLOWED);
    for curve in &mut curves {
        curve.points.sort_by(|a, b| a.x.total_cmp(&b.x));
    }
    curves
}

#[cfg(test)]
mod tests {
    use spec::{SamplerKind, Start};

    use super::super::tests::report;
    use super::*;
    use wire::{Latency, PredictorKind};

    use crate::report::tests::named;

    fn sampled(curve: &str, steps: u32) -> PredictorInfo {
        PredictorInfo {
            sampling: Some(SamplingInfo {
                curve: curve.to_owned(),
                kind: SamplerKind::Ddim,
                steps,
                start: Start::Cold,
            }),
            latency: Some(Latency {
                median_ms: f64::from(steps),
                p99_ms: 50.0,
                repeats: 100,
                threads: 2,
                device: "cpu".to_owned(),
                load: None,
            }),
            ..named(&format!("{curve} {steps}"), PredictorKind::Checkpoint)
        }
    }

    #[test]
    fn predictors_that_differ_in_steps_are_one_curve_in_their_order() {
        let held = named("hold-last", PredictorKind::Baseline);
        let predictors = vec![held, sampled("cold", 10), sampled("shifted", 5), sampled("cold", 2)];
        let report = report(predictors, Vec::new());
        for figure in [latency_figure(&report), sampler_steps_figure(&report, &report.groups[0])] {
            let steps: Vec<Vec<f64>> = figure
                .series
                .iter()
                .map(|series| series.points.iter().map(|point| point.x).collect())
                .collect();
            assert_eq!(steps, [vec![2.0, 10.0], vec![5.0]]);
            assert!(figure.to_svg(figures::Size::PAGE).is_ok());
        }
    }
}
