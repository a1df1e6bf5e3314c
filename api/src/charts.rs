//! The figures that the server draws itself.

use figures::{Axis, Figure, FigureError, Point, Series, Size};
use store::SeriesPoint;

use crate::app::{StoredTrajectory, Summary};

/// One of several panels on a sheet.
const PANEL: Size = Size { width: 760, height: 260 };

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

/// What a trajectory may have recorded: the beginning of its columns' names, what they measure,
/// and how one is called in a legend.
const PANELS: [(&str, &str, &str); 5] = [
    ("u", "torque", "joint "),
    ("q", "position", "joint "),
    ("qd", "velocity", "joint "),
    ("ee_", "position of the hand", ""),
    ("ee_q", "orientation of the hand", "q"),
];

/// A panel per quantity, over time.
///
/// # Errors
/// When drawing fails.
pub fn trajectory_svg(trajectory: &StoredTrajectory) -> Result<String, FigureError> {
    let StoredTrajectory { dataset, index, .. } = trajectory;
    let title = format!("Trajectory {index} of dataset {dataset}");
    let panels: Vec<Figure> = PANELS
        .iter()
        .map(|(prefix, quantity, called)| panel(trajectory, prefix, quantity, called))
        .filter(|panel| !panel.series.is_empty())
        .collect();
    figures::stacked(&title, &panels, PANEL)
}

fn panel(trajectory: &StoredTrajectory, prefix: &str, quantity: &str, called: &str) -> Figure {
    let mut y = Axis::linear(quantity);
    let mut series = Vec::new();
    for channel in trajectory.channels() {
        let Some(which) = channel.column.name.strip_prefix(prefix) else { continue };
        // `qd1` is no `q`, and `ee_qx` is no position.
        let is_axis = prefix.starts_with("ee") && which.len() == 1;
        if !is_axis && which.parse::<u32>().is_err() {
            continue;
        }
        if let Some(unit) = &channel.column.unit {
            y = y.in_unit(unit.as_str());
        }
        let points = trajectory.times().zip(channel.values);
        let points = points.map(|(time, value)| Point::new(time, f64::from(*value))).collect();
        series.push(Series::line(format!("{called}{which}"), points));
    }
    let x = Axis::linear("time").in_unit("s");
    Figure { title: capitalized(quantity), x, y, series, bands: Vec::new() }
}

fn capitalized(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// A panel per signal.
///
/// # Errors
/// When drawing fails.
pub fn spectra_svg(summary: &Summary) -> Result<String, FigureError> {
    let title = format!("Mean spectra of dataset {}", summary.dataset);
    figures::stacked(&title, &spectra(summary), PANEL)
}

pub fn spectra_csv(summary: &Summary) -> String {
    let mut text = "signal,unit,frequency (Hz),power spectral density\n".to_owned();
    for spectrum in &summary.spectra {
        for (band, density) in (0u32..).zip(&spectrum.density) {
            let frequency = f64::from(band) * spectrum.step_hz;
            let (signal, unit) = (&spectrum.signal, &spectrum.unit);
            text.push_str(&format!("{signal},{unit},{frequency},{density}\n"));
        }
    }
    text
}

fn spectra(summary: &Summary) -> Vec<Figure> {
    let signals = [("u", "Torque"), ("q", "Position")];
    let figure = |(signal, title): (&str, &str)| {
        let spectrum = summary.spectra.iter().find(|spectrum| spectrum.signal == signal);
        let unit = spectrum.map_or("", |spectrum| spectrum.unit.as_str());
        let points = spectrum.into_iter().flat_map(|spectrum| {
            // The mean was removed: what is left in the first band says nothing.
            let bands = (0u32..).zip(&spectrum.density).skip(1);
            bands.map(|(band, density)| {
                Point::new(f64::from(band) * spectrum.step_hz, f64::from(*density))
            })
        });
        Figure {
            title: title.to_owned(),
            x: Axis::log("frequency").in_unit("Hz"),
            y: Axis::log("density").in_unit(unit),
            series: vec![Series::line(signal, points.collect())],
            bands: Vec::new(),
        }
    };
    signals.map(figure).into()
}
