//! The figure of predictions beside the truth.

use figures::{Axis, Band, Curve, Figure, FigureError, Point, Size};
use wire::{TrajectoryPrediction, TrajectoryPredictions};

/// The error over the horizon, and a panel per joint with the truth and the predictions. `names` has
/// the names of the predictors in evaluations, which decide their colours.
///
/// # Errors
/// When drawing fails.
pub fn predictions_svg(
    predictions: &TrajectoryPredictions,
    names: &[String],
) -> Result<String, FigureError> {
    let TrajectoryPredictions { dataset, trajectory, truth, .. } = predictions;
    let title = format!("Predictions of trajectory {trajectory} of dataset {dataset}");
    let joints = truth.first().map_or(0, Vec::len);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut panels = vec![errors_over_horizon(predictions, &names)];
    panels.extend((0..joints).map(|joint| of_joint(predictions, joint, &names)));
    figures::stacked(&title, &panels, Size { width: 760, height: 280 })
}

/// The time of a sample since the last known one, s.
fn since_context(predictions: &TrajectoryPredictions, sample: usize) -> f64 {
    (sample as f64 - (predictions.begin as f64 - 1.0)) / predictions.rate_hz
}

fn errors_over_horizon(predictions: &TrajectoryPredictions, names: &[&str]) -> Figure {
    let time = |step: usize| since_context(predictions, predictions.begin + step);
    let curve = |(prediction, name): (&TrajectoryPrediction, &&str)| {
        let errors = prediction.step_rmse_deg.iter().enumerate();
        let points = errors.map(|(step, error)| Point::new(time(step), *error)).collect();
        Curve::line(&prediction.name, points).of_predictor(name, names)
    };
    Figure {
        title: "Error over the horizon, RMS over joints".to_owned(),
        x: Axis::linear("Time since the end of the context").in_unit("s"),
        y: Axis::log("error").in_unit("°"),
        series: predictions.predictions.iter().zip(names).map(curve).collect(),
        bands: Vec::new(),
    }
}

fn of_joint(predictions: &TrajectoryPredictions, joint: usize, names: &[&str]) -> Figure {
    let TrajectoryPredictions { begin, first, truth, .. } = predictions;
    let time = |sample: usize| since_context(predictions, sample);
    let degrees = |row: &Vec<f32>| f64::from(row[joint]).to_degrees();
    let of_horizon = |y: &[Vec<f32>]| -> Vec<Point> {
        let steps = y.iter().enumerate();
        steps.map(|(step, row)| Point::new(time(begin + step), degrees(row))).collect()
    };
    let points = truth.iter().enumerate().map(|(k, row)| Point::new(time(first + k), degrees(row)));
    let mut series = vec![Curve::line("truth", points.collect()).measured()];
    for (prediction, name) in predictions.predictions.iter().zip(names) {
        let line =
            |points: Vec<Point>| Curve::line(&prediction.name, points).of_predictor(name, names);
        series.extend(prediction.samples.iter().map(|y| line(of_horizon(y)).faint()));
        let mut points = of_horizon(&prediction.y);
        if let [low, high] = &prediction.quantiles[..] {
            for (point, (low, high)) in points.iter_mut().zip(low.y.iter().zip(&high.y)) {
                (point.low, point.high) = (Some(degrees(low)), Some(degrees(high)));
            }
        }
        series.push(line(points));
    }
    Figure {
        title: format!("Joint {}", joint + 1),
        x: Axis::linear("Time since the end of the context").in_unit("s"),
        y: Axis { range: range(&series), ..Axis::linear("position").in_unit("°") },
        series,
        bands: vec![Band { from: time(*first), to: 0.0, label: "context".to_owned() }],
    }
}

/// The range of the truth with as much room around it, where a prediction goes further; otherwise the data decide.
fn range(series: &[Curve]) -> Option<(f64, f64)> {
    let extent = |curves: &[Curve]| {
        let values = curves.iter().flat_map(|curve| &curve.points).flat_map(|point| {
            [point.y, point.low.unwrap_or(point.y), point.high.unwrap_or(point.y)]
        });
        values.fold((f64::INFINITY, f64::MIN), |(low, high), y| (low.min(y), high.max(y)))
    };
    let (low, high) = extent(&series[..1]);
    let room = (high - low).max(0.01);
    let (lowest, highest) = extent(series);
    let range = (lowest.max(low - room), highest.min(high + room));
    (lowest < low - room || highest > high + room).then_some(range)
}

#[cfg(test)]
mod tests {
    use figures::Stroke;

    use super::*;

    /// The second checkpoint of the page was vermillion, and bluish green in its evaluation.
    #[test]
    fn a_predictor_has_its_colour_of_evaluations_in_every_panel() {
        let prediction = |name: &str, checkpoint| TrajectoryPrediction {
            name: name.to_owned(),
            checkpoint,
            y: vec![vec![0.0]],
            samples: vec![vec![vec![0.1]]],
            step_rmse_deg: vec![1.0],
            ..TrajectoryPrediction::default()
        };
        let predictions = TrajectoryPredictions {
            rate_hz: 60.0,
            begin: 1,
            truth: vec![vec![0.0], vec![0.0]],
            predictions: vec![
                prediction("cdt 4", Some(4)),
                prediction("robomorph 7", Some(7)),
                prediction("hold-last", None),
            ],
            ..TrajectoryPredictions::default()
        };
        let names = ["cdt", "robomorph", "hold-last"];
        let expected = names.map(|name| Some(figures::predictor_colour(name, &[])));
        let colours = |figure: &Figure| -> Vec<Option<usize>> {
            let drawn = figure.series.iter().filter(|curve| curve.stroke != Stroke::Wide);
            drawn.map(|curve| curve.colour).collect()
        };
        assert_eq!(colours(&errors_over_horizon(&predictions, &names)), expected);
        let with_samples: Vec<Option<usize>> =
            expected.iter().flat_map(|colour| [*colour, *colour]).collect();
        let of_joint = of_joint(&predictions, 0, &names);
        assert_eq!(colours(&of_joint), with_samples);
    }
}
