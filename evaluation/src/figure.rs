use figures::{Axis, Band, Figure, Mark, Point, Scale, Series, Stroke};
use spec::Family;

use crate::{PredictorKind, Report};

/// RMSE over frequency of one excitation family, the training's frequencies shaded.
pub fn rmse_figure(report: &Report, family: Family) -> Figure {
    let cells = || report.cells.iter().filter(move |cell| cell.family == family);
    let series = report.predictors.iter().enumerate().map(|(i, info)| Series {
        name: info.name.clone(),
        points: cells()
            .map(|cell| {
                let interval = cell.rmse_deg[i].interval;
                Point {
                    x: cell.frequency_hz,
                    y: interval.mean,
                    low: Some(interval.low),
                    high: Some(interval.high),
                }
            })
            .collect(),
        mark: Mark::LineAndMarkers,
        stroke: match info.kind {
            PredictorKind::Checkpoint => Stroke::Solid,
            PredictorKind::Baseline => Stroke::Dashed,
        },
    });
    let bands =
        report.in_distribution.iter().filter(|seen| seen.family == family).map(|seen| Band {
            from: seen.frequency_hz.min,
            to: seen.frequency_hz.max,
            label: "in distribution".to_owned(),
        });
    Figure {
        title: format!("Prediction error over {family} frequency"),
        x: Axis {
            label: "Master frequency".to_owned(),
            unit: Some("Hz".to_owned()),
            scale: Scale::Linear,
            range: None,
        },
        y: Axis {
            label: "RMSE".to_owned(),
            unit: Some("deg".to_owned()),
            scale: Scale::Log,
            range: None,
        },
        series: series.collect(),
        bands: bands.collect(),
    }
}
