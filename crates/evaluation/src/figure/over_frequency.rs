//! Figures over the frequencies of a grid.

use figures::{Axis, Band, Curve, Figure, Point, SERIES_ALLOWED};
use spec::Family;
use wire::{CellSummary, Interval, PredictorInfo, Report, at_noise};

use super::{drawn, line, point};

/// RMSE over frequency of one excitation family at one level of noise, the training's frequencies shaded.
pub fn rmse_figure(report: &Report, family: Family, position_noise_rad: f64) -> Figure {
    let found = |cell: &CellSummary, info: &PredictorInfo| {
        let summary = cell.rmse_deg.iter().find(|summary| summary.predictor == info.name);
        summary.map(|summary| summary.interval)
    };
    over_frequency(report, (family, position_noise_rad), "Prediction error", "RMSE", found)
}

/// CRPS over frequency of one excitation family at one level of noise, of the predictors with samples.
pub fn crps_figure(report: &Report, family: Family, position_noise_rad: f64) -> Figure {
    let found = |cell: &CellSummary, info: &PredictorInfo| {
        let scores = cell.scores.iter().find(|scores| scores.predictor == info.name);
        scores.and_then(|scores| scores.crps_deg)
    };
    over_frequency(
        report,
        (family, position_noise_rad),
        "Continuous ranked probability score",
        "CRPS",
        found,
    )
}

fn over_frequency(
    report: &Report,
    (family, position_noise_rad): (Family, f64),
    title: &str,
    label: &str,
    found: impl Fn(&CellSummary, &PredictorInfo) -> Option<Interval>,
) -> Figure {
    let cells = || {
        report.cells.iter().filter(move |cell| {
            cell.family == Some(family) && cell.position_noise_rad == position_noise_rad
        })
    };
    let series = drawn(report).map(|info| {
        let points: Vec<Point> = cells()
            .filter_map(|cell| Some(point(cell.frequency_hz?, found(cell, info)?)))
            .collect();
        line(report, info, points)
    });
    let bands =
        report.in_distribution.iter().filter(|seen| seen.family == family).map(|seen| Band {
            from: seen.frequency_hz.min,
            to: seen.frequency_hz.max,
            label: "in distribution".to_owned(),
        });
    Figure {
        title: format!("{title} over {family} frequency{}", at_noise(position_noise_rad)),
        x: Axis::linear("Master frequency").in_unit("Hz"),
        y: Axis::log(label).in_unit("deg"),
        series: series
            .filter(|curve: &Curve| !curve.points.is_empty())
            .take(SERIES_ALLOWED)
            .collect(),
        bands: bands.collect(),
    }
}
