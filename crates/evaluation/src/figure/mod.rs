//! Figures of a report.

mod colours;
mod over_frequency;
mod over_steps;
mod prediction;

use figures::{Axis, Curve, Figure, Mark, Point, SERIES_ALLOWED, Stroke};

pub use colours::colour_of;
pub use over_frequency::{crps_figure, rmse_figure};
pub use over_steps::{latency_figure, sampler_steps_figure};
pub use prediction::{DrawnAnswer, prediction_figure};
use wire::{GroupSummary, Interval, PredictorInfo, PredictorKind, PredictorScores, Report};

/// RMSE of every predictor at each step of the horizon, over the scenarios of one group.
pub fn horizon_figure(report: &Report, group: &GroupSummary) -> Figure {
    let series = of_predictors(report, &group.scores, |scores| {
        let steps = scores.step_rmse_deg.iter().enumerate();
        steps.map(|(k, rmse)| Point::new((k + 1) as f64 / report.rate_hz, *rmse)).collect()
    });
    Figure {
        title: format!("Prediction error along the horizon, {}", group.name),
        x: Axis::linear("Time since the last known position").in_unit("s"),
        y: Axis::log("RMSE").in_unit("deg"),
        series,
        bands: Vec::new(),
    }
}

/// Share of measured positions inside central intervals over their probability. The diagonal is
/// that of a perfectly calibrated predictor. The figure has only predictors with samples.
pub fn calibration_figure(report: &Report, group: &GroupSummary) -> Figure {
    let mut series = of_predictors(report, &group.scores, |scores| {
        scores.calibration.iter().map(|at| Point::new(at.nominal, at.coverage)).collect()
    });
    let ideal = vec![Point::new(0.0, 0.0), Point::new(1.0, 1.0)];
    series.push(Curve::line("calibrated", ideal).dashed().coloured(figures::MEASURED));
    let share = |label: &str| Axis { range: Some((0.0, 1.0)), ..Axis::linear(label) };
    Figure {
        title: format!("Calibration, {}", group.name),
        x: share("Probability of the central interval"),
        y: share("Share of positions inside"),
        series,
        bands: Vec::new(),
    }
}

/// A series for each predictor that has points, up to the limit of a figure. If predictors differ
/// only in the sampler's steps, only the one with the most is drawn. The others are in the figure
/// over steps.
fn of_predictors(
    report: &Report,
    scores: &[PredictorScores],
    points: impl Fn(&PredictorScores) -> Vec<Point>,
) -> Vec<Curve> {
    let found = drawn(report).filter_map(|info| {
        let scores = scores.iter().find(|scores| scores.predictor == info.name)?;
        Some(line(report, info, points(scores)))
    });
    // One place is kept for a diagonal.
    found.filter(|curve| !curve.points.is_empty()).take(SERIES_ALLOWED - 1).collect()
}

fn drawn(report: &Report) -> impl Iterator<Item = &PredictorInfo> {
    let has_more_steps = |info: &PredictorInfo| {
        let Some(own) = &info.sampling else { return false };
        let mut others = report.predictors.iter().filter_map(|info| info.sampling.as_ref());
        others.any(|other| other.curve == own.curve && other.steps > own.steps)
    };
    report.predictors.iter().filter(move |info| !has_more_steps(info))
}

/// Checkpoints and files of predictions are solid, baselines dashed.
fn line(report: &Report, info: &PredictorInfo, points: Vec<Point>) -> Curve {
    Curve {
        colour: Some(colour_of(&report.predictors, &info.name)),
        name: info.name.clone(),
        points,
        mark: Mark::LineAndMarkers,
        stroke: match info.kind {
            PredictorKind::Checkpoint | PredictorKind::Predictions => Stroke::Solid,
            PredictorKind::Baseline => Stroke::Dashed,
        },
    }
}

fn point(x: f64, Interval { mean, low, high }: Interval) -> Point {
    Point::with_interval(x, mean, low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::{Calibration, PredictorSummary};

    use crate::report::tests::named;

    pub(super) fn report(predictors: Vec<PredictorInfo>, scores: Vec<PredictorScores>) -> Report {
        let rmse = |info: &PredictorInfo| PredictorSummary {
            predictor: info.name.clone(),
            interval: Interval { mean: 2.0, low: 1.5, high: 2.5 },
        };
        let group = GroupSummary {
            rollouts: Vec::new(),
            name: "in distribution".to_owned(),
            position_noise_rad: 0.0,
            scenarios: 100,
            rmse_deg: predictors.iter().map(rmse).collect(),
            scores,
            replications: Vec::new(),
            replication_differences: Vec::new(),
        };
        Report {
            context: 320,
            horizon: 3,
            rate_hz: 60.0,
            samples: 1,
            given: spec::Given::Torques,
            data_noise: None,
            bootstrap: spec::Bootstrap::default(),
            predictors,
            in_distribution: Vec::new(),
            cells: Vec::new(),
            groups: vec![group],
            paired: Vec::new(),
            failures: Vec::new(),
            worst: Vec::new(),
            shifts: Vec::new(),
            warnings: Vec::new(),
        }
    }

    fn scores(predictor: &str, calibration: Vec<Calibration>) -> PredictorScores {
        PredictorScores {
            predictor: predictor.to_owned(),
            step_rmse_deg: vec![0.1, 0.4, 0.9],
            calibration,
            ..PredictorScores::default()
        }
    }

    #[test]
    fn errors_along_the_horizon_begin_one_period_after_the_last_known_position() {
        let report =
            report(vec![named("held", PredictorKind::Baseline)], vec![scores("held", Vec::new())]);
        let figure = horizon_figure(&report, &report.groups[0]);
        assert_eq!(figure.series[0].points[0], Point::new(1.0 / 60.0, 0.1));
        assert!(figure.to_svg(figures::Size::PAGE).is_ok());
    }

    #[test]
    fn only_predictors_with_samples_are_in_the_calibration() {
        let calibrated = vec![Calibration { nominal: 0.5, coverage: 0.4 }];
        let report = report(
            vec![named("held", PredictorKind::Baseline), named("cdt", PredictorKind::Checkpoint)],
            vec![scores("held", Vec::new()), scores("cdt", calibrated)],
        );
        let figure = calibration_figure(&report, &report.groups[0]);
        let names: Vec<&str> = figure.series.iter().map(|series| series.name.as_str()).collect();
        assert_eq!(names, ["cdt", "calibrated"]);
        assert!(figure.to_svg(figures::Size::PAGE).is_ok());
    }
}
