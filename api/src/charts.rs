//! The figures that the server draws itself.

use figures::{Axis, Figure, Point, Series};
use store::SeriesPoint;

/// Training and validation loss over optimizer steps.
pub fn loss_figure(training: &[SeriesPoint], validation: &[SeriesPoint]) -> Figure {
    let points = |of: &[SeriesPoint]| -> Vec<Point> {
        of.iter().map(|point| Point::new(step(point.step), point.value)).collect()
    };
    Figure {
        title: "Training and validation loss".to_owned(),
        x: Axis::linear("optimizer step"),
        y: Axis::log("loss"),
        series: vec![
            Series::line("training", points(training)),
            Series::line("validation", points(validation)).with_markers(),
        ],
        bands: Vec::new(),
    }
}

#[expect(clippy::cast_precision_loss, reason = "a position in a drawing")]
fn step(step: u64) -> f64 {
    step as f64
}
