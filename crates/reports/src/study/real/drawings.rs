//! The report's figures: errors over the horizon, and over the length of the context.

use figures::{Axis, Curve, Figure, Point, Size};
use wire::Interval;

use super::super::results::{File, Study};
use super::{Asked, CONTEXTS, USUAL, mean};

pub fn figures(study: &Study) -> anyhow::Result<Vec<File>> {
    let drawn = [("over-horizon", over_horizon(study)), ("contexts", contexts(study))];
    let file = |(name, figure): (&str, Figure)| {
        let bytes = figure.to_svg(Size::PAGE)?.into_bytes();
        Ok(File { name: format!("{name}.svg"), bytes })
    };
    drawn.into_iter().map(file).collect()
}

/// RMSE of every predictor at each step of the horizon, on arms as in training.
fn over_horizon(study: &Study) -> Figure {
    let asked = Asked::of(study, USUAL);
    let curves = asked.into_iter().flat_map(|asked| {
        let rate_hz = asked.evaluation.report.rate_hz;
        let rows = asked.rows();
        let names: Vec<&str> = rows.iter().map(|row| row.name).collect();
        rows.into_iter().map(move |row| {
            let scores = asked.scores(&row);
            let steps = scores.iter().map(|scores| scores.step_rmse_deg.len()).min().unwrap_or(0);
            let point = |step: usize| {
                let each = scores.iter().map(|scores| scores.step_rmse_deg[step]);
                Some(Point::new((step + 1) as f64 / rate_hz, mean(each)?))
            };
            let points = (0..steps).filter_map(point).collect();
            Curve::line(row.name, points).of_predictor(row.name, &names)
        })
    });
    Figure {
        title: "Root mean square error over the horizon".to_owned(),
        x: Axis::linear("time").in_unit("s"),
        y: Axis::log("RMSE").in_unit("°"),
        series: curves.collect(),
        bands: Vec::new(),
    }
}

/// RMSE over the whole horizon by the length of the context.
fn contexts(study: &Study) -> Figure {
    let asked: Vec<Asked<'_>> = CONTEXTS.iter().filter_map(|name| Asked::of(study, name)).collect();
    let rows = asked.first().map(|first| first.rows()).unwrap_or_default();
    let names: Vec<&str> = rows.iter().map(|row| row.name).collect();
    let curves = rows.iter().map(|row| {
        let point = |asked: &Asked<'_>| {
            let last = asked.seconds().last().copied()?;
            let Interval { mean, low, high } = asked.row(row.name)?.error(last)?.rmse_deg;
            // The axis is logarithmic, and an interval over few seeds may reach below 0.
            Some(Point::with_interval(asked.context_s(), mean, low.max(0.1 * mean), high))
        };
        let points = asked.iter().filter_map(point).collect();
        Curve::line(row.name, points).with_markers().of_predictor(row.name, &names)
    });
    Figure {
        title: "RMSE over the whole horizon by the length of the context".to_owned(),
        x: Axis::log("context").in_unit("s"),
        y: Axis::log("RMSE").in_unit("°"),
        series: curves.collect(),
        bands: Vec::new(),
    }
}
