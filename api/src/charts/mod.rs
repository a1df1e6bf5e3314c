//! The figures that the server draws.

mod predictions;

use std::collections::BTreeMap;

use figures::{Axis, Curve, Figure, FigureError, Point, SERIES_ALLOWED, Size};
use store::{CurvePoint, TrackedMetric};
use wire::{SpectrumSummary, Summary};

use crate::app::trajectories::StoredTrajectory;

pub use predictions::predictions_svg;

/// The size of one panel of several.
const PANEL: Size = Size { width: 760, height: 300 };

/// The curves of a training over its optimizer steps.
#[derive(Default)]
pub struct TrainingCurves {
    pub loss: Vec<CurvePoint>,
    pub validation_loss: Vec<CurvePoint>,
    /// RMSE of joint positions, degrees.
    pub validation_rmse: Vec<CurvePoint>,
}

impl TrainingCurves {
    /// The validation RMSE, which says how good the model is, above the losses. Without an RMSE,
    /// the losses alone.
    ///
    /// # Errors
    /// When drawing fails.
    pub fn svg(&self) -> Result<String, FigureError> {
        if self.validation_rmse.is_empty() {
            return self.losses().to_svg(Size::PAGE);
        }
        figures::stacked("Validation error and loss", &[self.rmse(), self.losses()], PANEL)
    }

    /// Training and validation loss.
    pub fn losses(&self) -> Figure {
        let Self { loss, validation_loss, .. } = self;
        let curves = [
            Curve::line("training", points(loss)),
            Curve::line("validation", points(validation_loss)).with_markers(),
        ];
        Figure {
            title: "Training and validation loss".to_owned(),
            x: Axis::linear("optimizer step"),
            y: loss_axis("loss", loss.iter().chain(validation_loss)),
            series: curves.into_iter().filter(|curve| !curve.points.is_empty()).collect(),
            bands: Vec::new(),
        }
    }

    fn rmse(&self) -> Figure {
        Figure {
            title: "RMSE of joint positions in validation".to_owned(),
            x: Axis::linear("optimizer step"),
            y: loss_axis("RMSE", &self.validation_rmse).in_unit("°"),
            series: vec![Curve::line("validation", points(&self.validation_rmse)).with_markers()],
            bands: Vec::new(),
        }
    }
}

fn points(curve: &[CurvePoint]) -> Vec<Point> {
    curve.iter().map(|point| Point::new(step(point.step), point.value)).collect()
}

/// A logarithmic axis, if every value has a place on it. A negative log-likelihood has none.
fn loss_axis<'a>(label: &str, curve: impl IntoIterator<Item = &'a CurvePoint>) -> Axis {
    let mut values = curve.into_iter().map(|point| point.value);
    if values.any(|value| value <= 0.0) { Axis::linear(label) } else { Axis::log(label) }
}

#[expect(clippy::cast_precision_loss, reason = "a position in a drawing")]
fn step(step: u64) -> f64 {
    step as f64
}

/// The horizontal axis of curves beside each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Over {
    /// Optimizer steps.
    Step,
    /// Time since the first point of a run.
    Time,
}

/// The curves of a run, or of runs that repeat each other.
pub struct Overlaid {
    pub name: String,
    pub curves: Vec<Vec<CurvePoint>>,
}

/// A metric of several runs in one figure. Of runs that repeat each other it has the mean at the steps that all
/// of them have, and a band from the least to the largest value. `smoothing` is the weight of what
/// came before; the raw curve then stands pale behind the smoothed one.
pub fn overlaid(key: &str, over: Over, smoothing: f64, all: &[Overlaid]) -> Figure {
    let values = all.iter().flat_map(|group| group.curves.iter().flatten());
    let y = loss_axis(key, values);
    let curve = |group: &Overlaid| {
        let curves: Vec<BTreeMap<u64, [f64; 2]>> =
            group.curves.iter().map(|curve| smoothed(curve, over, smoothing)).collect();
        let first = curves.first().cloned().unwrap_or_default();
        let points = first.keys().filter_map(|step| {
            let at: Vec<[f64; 2]> =
                curves.iter().map(|curve| curve.get(step).copied()).collect::<Option<_>>()?;
            let mean = |k: usize| at.iter().map(|point| point[k]).sum::<f64>() / at.len() as f64;
            let values = at.iter().map(|point| point[1]);
            let (low, high) =
                (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::MIN, f64::max));
            let several = at.len() > 1;
            Some(Point {
                low: several.then_some(low),
                high: several.then_some(high),
                ..Point::new(mean(0), mean(1))
            })
        });
        Curve::line(&group.name, points.collect())
    };
    let coloured = |(place, curve): (usize, Curve)| curve.compared(place);
    let curves: Vec<Curve> = all
        .iter()
        .map(curve)
        .enumerate()
        .map(coloured)
        .filter(|curve| !curve.points.is_empty())
        .collect();
    let raw = |(place, group): (usize, &Overlaid)| match &group.curves[..] {
        [only] if smoothing > 0.0 && 2 * all.len() <= SERIES_ALLOWED => {
            let points = smoothed(only, over, 0.0).into_values().map(|[x, y]| Point::new(x, y));
            Some(coloured((place, Curve::line(&group.name, points.collect()).faint())))
        }
        _ => None,
    };
    let behind: Vec<Curve> = all.iter().enumerate().filter_map(raw).collect();
    Figure {
        title: key.to_owned(),
        x: match over {
            Over::Step => Axis::linear("optimizer step"),
            Over::Time => Axis::linear("time").in_unit("s"),
        },
        y,
        series: behind.into_iter().chain(curves).collect(),
        bands: Vec::new(),
    }
}

/// A run in a figure of points.
pub struct Scattered {
    pub name: String,
    /// The place of its curve among those of [`overlaid`], which gives its colour.
    pub colour: usize,
    /// The number in its spec.
    pub at: Option<f64>,
    /// The latest value of the metric.
    pub value: Option<f64>,
}

/// The latest value of a metric over a number in the spec: a point for each run that has both.
pub fn scatter(parameter: &str, key: &str, runs: &[Scattered]) -> Figure {
    let point = |run: &Scattered| {
        let points = vec![Point::new(run.at?, run.value?)];
        Some(Curve::line(&run.name, points).compared(run.colour).with_markers())
    };
    let series: Vec<Curve> = runs.iter().filter_map(point).collect();
    let points = || series.iter().flat_map(|curve| &curve.points);
    // Rates and sizes are chosen by factors.
    let is_wide = |of: &dyn Fn(&Point) -> f64| {
        let (low, high) = points()
            .map(of)
            .fold((f64::INFINITY, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
        low > 0.0 && high >= 5.0 * low
    };
    let axis = |label: &str, is_log: bool| match is_log {
        true => Axis::log(label),
        false => Axis::linear(label),
    };
    Figure {
        title: format!("{key} over {parameter}"),
        x: axis(parameter, is_wide(&|point| point.x)),
        y: axis(key, is_wide(&|point| point.y)),
        series,
        bands: Vec::new(),
    }
}

/// Exponentially weighted means, with the weights of the values so far adding up to one: place and value by step.
fn smoothed(curve: &[CurvePoint], over: Over, smoothing: f64) -> BTreeMap<u64, [f64; 2]> {
    let start = curve.first().map_or(0, |point| point.time.milliseconds());
    let (mut sum, mut weight) = (0.0, 0.0);
    let finite = curve.iter().filter(|point| point.value.is_finite());
    finite
        .map(|point| {
            sum = smoothing * sum + (1.0 - smoothing) * point.value;
            weight = smoothing * weight + (1.0 - smoothing);
            let place = match over {
                Over::Step => step(point.step),
                Over::Time => seconds(point.time.milliseconds() - start),
            };
            (point.step, [place, sum / weight])
        })
        .collect()
}

#[expect(clippy::cast_precision_loss, reason = "a position in a drawing")]
fn seconds(milliseconds: i64) -> f64 {
    milliseconds as f64 / 1e3
}

/// A metric that a client of MLflow logged, over its steps.
pub fn logged(key: &str, points: &[TrackedMetric]) -> Figure {
    let points: Vec<Point> =
        points.iter().map(|point| Point::new(point.step as f64, point.value)).collect();
    let is_positive = points.iter().all(|point| point.y > 0.0 || !point.y.is_finite());
    Figure {
        title: key.to_owned(),
        x: Axis::linear("step"),
        y: if is_positive { Axis::log(key) } else { Axis::linear(key) },
        series: vec![Curve::line(key, points)],
        bands: Vec::new(),
    }
}

/// A quantity that a trajectory may have.
struct Panel {
    title: &'static str,
    /// The quantity on the vertical axis.
    quantity: &'static str,
    /// The prefix of its columns' names; a joint's number or an axis follows.
    prefix: &'static str,
    /// The prefix of its names in the legend.
    called: &'static str,
}

const PANELS: [Panel; 7] = [
    Panel { title: "Torques", quantity: "u", prefix: "u", called: "joint " },
    Panel { title: "Positions", quantity: "q", prefix: "q", called: "joint " },
    Panel { title: "Measured torques", quantity: "u", prefix: "u_measured", called: "joint " },
    Panel { title: "Measured positions", quantity: "q", prefix: "q_measured", called: "joint " },
    Panel { title: "Velocities", quantity: "q\u{307}", prefix: "qd", called: "joint " },
    Panel { title: "Position of the hand", quantity: "position", prefix: "ee_", called: "" },
    Panel { title: "Orientation of the hand", quantity: "quaternion", prefix: "ee_q", called: "q" },
];

/// One panel per quantity, over time.
///
/// # Errors
/// When drawing fails.
pub fn trajectory_svg(trajectory: &StoredTrajectory) -> Result<String, FigureError> {
    let StoredTrajectory { dataset, index, .. } = trajectory;
    let title = format!("Trajectory {index} of dataset {dataset}");
    let figures: Vec<Figure> = PANELS
        .iter()
        .map(|panel| panel.figure(trajectory))
        .filter(|figure| !figure.series.is_empty())
        .collect();
    figures::stacked(&title, &figures, PANEL)
}

/// The height of the figure of a trajectory with these columns, px.
pub fn trajectory_height(columns: &[&str]) -> u32 {
    let is_shown = |panel: &&Panel| columns.iter().any(|column| panel.which(column).is_some());
    let panels = u32::try_from(PANELS.iter().filter(is_shown).count()).unwrap_or(1);
    u32::from(PANEL.height) * panels
}

impl Panel {
    fn figure(&self, trajectory: &StoredTrajectory) -> Figure {
        let mut y = Axis::linear(self.quantity);
        let mut series = Vec::new();
        for channel in trajectory.channels() {
            let Some(which) = self.which(&channel.column.name) else { continue };
            if let Some(unit) = &channel.column.unit {
                y = y.in_unit(unit.as_str());
            }
            let points = trajectory.times().zip(channel.values);
            let points = points.map(|(time, value)| Point::new(time, f64::from(*value))).collect();
            series.push(Curve::line(format!("{}{which}", self.called), points));
        }
        let x = Axis::linear("time").in_unit("s");
        Figure { title: self.title.to_owned(), x, y, series, bands: Vec::new() }
    }

    /// The joint or axis of a column, if it belongs to this quantity: `qd1` is no `q`, and `ee_qx`
    /// is no position.
    fn which<'a>(&self, column: &'a str) -> Option<&'a str> {
        let which = column.strip_prefix(self.prefix)?;
        let is_joint = which.parse::<u32>().is_ok();
        let is_axis = self.prefix.starts_with("ee_") && ["x", "y", "z", "w"].contains(&which);
        (is_joint || is_axis).then_some(which)
    }
}

/// One panel per signal.
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
            let joint = spectrum.joint.map(|joint| joint.to_string()).unwrap_or_default();
            let (signal, unit) = (&spectrum.signal, &spectrum.unit);
            text.push_str(&format!("{signal}{joint},{unit},{frequency},{density}\n"));
        }
    }
    text
}

fn spectra(summary: &Summary) -> Vec<Figure> {
    let signals = [("u", "Torques"), ("q", "Positions")];
    let curve = |spectrum: &SpectrumSummary| {
        // The mean was removed, so the first band has no meaning.
        let bands = (0u32..).zip(&spectrum.density).skip(1);
        let points = bands.map(|(band, density)| {
            Point::new(f64::from(band) * spectrum.step_hz, f64::from(*density))
        });
        match spectrum.joint {
            Some(joint) => Curve::line(format!("joint {joint}"), points.collect()),
            None => Curve::line("all joints", points.collect()).measured(),
        }
    };
    let figure = |(signal, title): (&str, &str)| {
        let of_signal = || summary.spectra.iter().filter(|spectrum| spectrum.signal == signal);
        let unit = of_signal().next().map_or("", |spectrum| spectrum.unit.as_str());
        Figure {
            title: title.to_owned(),
            x: Axis::log("frequency").in_unit("Hz"),
            y: Axis::log("density").in_unit(unit),
            series: of_signal().map(curve).collect(),
            bands: Vec::new(),
        }
    };
    signals.map(figure).into()
}

#[cfg(test)]
mod tests {
    use figures::{Scale, Stroke};
    use store::Timestamp;

    use super::*;

    fn curve(values: &[f64]) -> Vec<CurvePoint> {
        let time = Timestamp::from_milliseconds(0);
        let steps = (0..).step_by(100);
        steps.zip(values).map(|(step, &value)| CurvePoint { step, time, value }).collect()
    }

    #[test]
    fn runs_that_repeat_each_other_are_a_mean_with_a_band_and_smoothing_starts_unbiased() {
        let group =
            |curves: Vec<Vec<CurvePoint>>| Overlaid { name: "4 5 train".to_owned(), curves };
        let both = group(vec![curve(&[1.0, 2.0, 3.0]), curve(&[3.0, 4.0])]);
        let alone = group(vec![curve(&[4.0, 2.0])]);
        let figure = overlaid("loss", Over::Step, 0.0, &[both, alone]);
        let point = figure.series[0].points[1];
        assert_eq!((point.x, point.y, point.low, point.high), (100.0, 3.0, Some(2.0), Some(4.0)));
        // The third step is not in both.
        assert_eq!(figure.series[0].points.len(), 2);
        let other = figure.series[1].points[0];
        assert_eq!((other.y, other.low), (4.0, None));
        let alone = group(vec![curve(&[4.0, 2.0])]);
        let smooth = overlaid("loss", Over::Time, 0.5, &[alone]);
        // The raw curve stands pale behind the smoothed one, in the same colour.
        let [raw, smooth] = &smooth.series[..] else { panic!("{smooth:?}") };
        assert_eq!((raw.points[1].y, raw.stroke, raw.colour), (2.0, Stroke::Faint, smooth.colour));
        let values: Vec<f64> = smooth.points.iter().map(|point| point.y).collect();
        assert!((values[0] - 4.0).abs() < 1e-12 && (values[1] - 8.0 / 3.0).abs() < 1e-12);
    }

    /// The black one of the points was the orange one of the curves.
    #[test]
    fn a_run_has_one_colour_in_its_curve_and_its_point() {
        let group = |_| Overlaid { name: "run".to_owned(), curves: vec![curve(&[2.0, 1.0])] };
        let groups: Vec<Overlaid> = (0..20).map(group).collect();
        let curves = overlaid("loss", Over::Step, 0.0, &groups).series;
        let run = |colour: usize| Scattered {
            name: "run".to_owned(),
            colour,
            at: Some(1.0),
            value: Some(1.0),
        };
        let points = scatter("steps", "loss", &(0..20).map(run).collect::<Vec<_>>()).series;
        let colours = |series: &[Curve]| series.iter().map(|it| it.colour).collect::<Vec<_>>();
        assert_eq!(colours(&curves), colours(&points));
        // Beyond the colours, dashes and markers tell curves apart.
        let mut looks = Vec::new();
        for Curve { colour, stroke, mark, .. } in curves {
            let look = (colour.map(|place| place % 10), stroke, mark);
            assert!(!looks.contains(&look), "{look:?}");
            looks.push(look);
        }
    }

    /// The loss of the `lagrangian` is a negative log-likelihood. Its curve had 26 of 500 points,
    /// and none of the validation that the legend named.
    #[test]
    fn every_point_of_a_loss_below_zero_is_drawn() {
        let curves = TrainingCurves {
            loss: curve(&[3.0, 0.5, 0.0, -2.0, -3.5]),
            validation_loss: curve(&[-1.0, -3.0]),
            validation_rmse: Vec::new(),
        };
        let figure = curves.losses();
        assert_eq!(figure.y.scale, Scale::Linear);
        let svg = curves.svg().unwrap();
        assert!(!svg.contains("not drawn"), "{svg}");
        let of_validation = TrainingCurves { loss: curve(&[3.0, 0.5]), ..curves };
        assert_eq!(of_validation.losses().y.scale, Scale::Linear);
    }

    #[test]
    fn losses_above_zero_stay_on_a_logarithmic_axis_with_no_curve_that_is_empty() {
        let curves = TrainingCurves { loss: curve(&[3.0, 1e-4]), ..TrainingCurves::default() };
        let figure = curves.losses();
        assert_eq!((figure.y.scale, figure.series.len()), (Scale::Log, 1));
        assert!(TrainingCurves::default().svg().unwrap().contains("no data yet"));
    }

    #[test]
    fn the_error_in_degrees_stands_above_the_losses() {
        let curves = TrainingCurves {
            loss: curve(&[-1.0]),
            validation_loss: curve(&[-1.0]),
            validation_rmse: curve(&[2.0, 0.05]),
        };
        let svg = curves.svg().unwrap();
        let place = |text: &str| svg.find(text).unwrap_or_else(|| panic!("{text} is not in {svg}"));
        assert!(place("RMSE of joint positions") < place("Training and validation loss"));
        assert_eq!(curves.rmse().y.scale, Scale::Log);
    }
}
