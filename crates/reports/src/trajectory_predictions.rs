//! The errors of the predictions of one stored trajectory.

use wire::{TrajectoryPrediction, TrajectoryPredictions, Unit};

use crate::numbers::step_at;
use crate::{Cell, Table, TableOf};

/// Times at which errors are told, s.
const TIMES_S: [f64; 3] = [0.1, 0.5, 1.33];

/// A row per prediction: its error over the horizon, at a few times, and in its worst joint.
pub fn table(predictions: &TrajectoryPredictions) -> Table {
    let degrees = |value: Option<f64>| {
        value.map_or(Cell::Missing, |value| Cell::Number(value, Unit::Degrees))
    };
    let step = |seconds: f64| step_at(seconds, predictions.rate_hz);
    let is_sampled = predictions.predictions.iter().any(|it| !it.samples.is_empty());
    let (rmse, of_samples) = match is_sampled {
        true => ("RMSE of the mean, °", " Errors of a model with samples are those of their mean."),
        false => ("RMSE, °", ""),
    };
    let note = format!(
        "RMSE over the horizon is the mean over joints; errors at a time are roots of means over joints.{of_samples}"
    );
    let table = TableOf::new(&predictions.predictions)
        .text("predictor", |prediction| prediction.name.as_str())
        .number(rmse, |prediction| degrees(Some(prediction.rmse_deg)));
    let table = TIMES_S.into_iter().fold(table, |table, seconds| {
        let heading = format!("at {seconds} s, °");
        table.number(&heading, move |prediction| {
            degrees(prediction.step_rmse_deg.get(step(seconds)).copied())
        })
    });
    table
        .number("worst joint, °", |prediction| degrees(worst(prediction).map(|(_, error)| error)))
        .number("joint", |prediction| match worst(prediction) {
            Some((joint, _)) => Cell::Count(joint),
            None => Cell::Missing,
        })
        .number("sampler steps", |prediction| match prediction.steps {
            Some(steps) => Cell::Count(steps.into()),
            None => Cell::Missing,
        })
        .number("computed in, ms", |prediction| match prediction.compute_ms {
            Some(milliseconds) => Cell::Number(milliseconds, Unit::Milliseconds),
            None => Cell::Missing,
        })
        .titled("Errors", &note)
        .without_empty_columns()
}

/// The joint with the largest error, from 1.
fn worst(prediction: &TrajectoryPrediction) -> Option<(u64, f64)> {
    let errors = (1..).zip(prediction.joint_rmse_deg.iter().copied());
    errors.max_by(|a, b| a.1.total_cmp(&b.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_at_times_beyond_the_horizon_have_no_column() {
        let prediction = TrajectoryPrediction {
            name: "lagrangian 5".to_owned(),
            checkpoint: Some(5),
            rmse_deg: 0.25,
            joint_rmse_deg: vec![0.1, 0.4],
            step_rmse_deg: (1..=60).map(f64::from).collect(),
            ..TrajectoryPrediction::default()
        };
        let mut predictions = TrajectoryPredictions {
            rate_hz: 100.0,
            predictions: vec![prediction],
            ..TrajectoryPredictions::default()
        };
        let text = table(&predictions).render();
        let mut lines = text.lines();
        let heading = lines.next().unwrap();
        assert!(heading.contains("at 0.5 s") && !heading.contains("1.33"), "{heading}");
        assert!(!heading.contains("sampler") && !heading.contains("computed"), "{heading}");
        let row: Vec<&str> = lines.next().unwrap().split_whitespace().collect();
        assert_eq!(row, ["lagrangian", "5", "0.25", "10.00", "50.00", "0.40", "2"]);

        predictions.predictions[0].samples = vec![vec![vec![0.0; 2]]];
        let text = table(&predictions).render();
        assert!(text.contains("RMSE of the mean, °"), "{text}");
    }
}
