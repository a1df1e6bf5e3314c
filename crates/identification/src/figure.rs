//! Figures of measured torques and motions beside those of an arm.

use figures::{Axis, Curve, Figure, FigureError, Point, Size, stacked};

use crate::arm::{Arm, Prior};
use crate::motion::Motion;
use crate::rollouts::Windows;
use crate::torques::Torques;
use crate::trace::Trace;

/// The longest part of a recording that figures show, s.
const SHOWN_S: f64 = 20.0;

/// The beginning of a recording, up to 20 s: the first of the validation, or else of the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// The recording's name.
    pub recording: String,
    /// The torque of each joint, N·m.
    pub torques: Vec<Trace>,
    /// The position of each joint, degrees. A prediction begins anew at the measured state whenever
    /// the longest horizon has passed.
    pub positions: Vec<Trace>,
}

impl Curves {
    pub(crate) fn new(motion: &Motion, prior: &Prior, arm: &Arm) -> Self {
        let motion = motion.part(0..motion.samples_in(SHOWN_S).min(motion.samples()));
        let motions = std::slice::from_ref(&motion);
        Self {
            recording: motion.name.clone(),
            torques: Torques::traces(&motion, &prior.arm, arm),
            positions: Windows::back_to_back(motions).traces(&prior.arm, arm),
        }
    }

    /// Torques, a panel per joint.
    ///
    /// # Errors
    /// Those of [`figures::stacked`].
    pub fn torques_svg(&self) -> Result<String, FigureError> {
        let title = format!("Torques of recording {}", self.recording);
        panels(&title, &Axis::linear("Torque").in_unit("N·m"), &self.torques)
    }

    /// Positions, a panel per joint. Lines are left out where they leave the
    /// picture.
    ///
    /// # Errors
    /// Those of [`figures::stacked`].
    pub fn positions_svg(&self) -> Result<String, FigureError> {
        let title = format!("Motion of recording {}, predicted anew every 1.33 s", self.recording);
        panels(&title, &Axis::linear("Position").in_unit("deg"), &self.positions)
    }

    /// The numbers of both figures: a row per joint and time.
    pub fn to_csv(&self) -> String {
        let mut csv = String::from("quantity,unit,joint,time_s,measured,description,identified\n");
        for (quantity, unit, traces) in
            [("torque", "N·m", &self.torques), ("position", "deg", &self.positions)]
        {
            for (joint, trace) in (1..).zip(traces) {
                for (k, time) in trace.times_s.iter().enumerate() {
                    let (measured, described, identified) =
                        (trace.measured[k], trace.described[k], trace.identified[k]);
                    csv += &format!(
                        "{quantity},{unit},{joint},{time:.4},{measured:.6},{described:.6},{identified:.6}\n"
                    );
                }
            }
        }
        csv
    }
}

fn panels(title: &str, y: &Axis, traces: &[Trace]) -> Result<String, FigureError> {
    const SIZE: Size = Size { width: 760, height: 260 };

    let panel = |(joint, trace): (usize, &Trace)| {
        let (low, high) = range(&trace.measured);
        let curve = |name: &str, values: &[f64]| {
            let points = trace.times_s.iter().zip(values);
            // A point that is not a number breaks the line.
            let points = points.map(|(time, value)| {
                let is_inside = (low..=high).contains(value);
                Point::new(*time, if is_inside { *value } else { f64::NAN })
            });
            Curve::line(name, points.collect())
        };
        Figure {
            title: format!("Joint {joint}"),
            x: Axis::linear("Time").in_unit("s"),
            y: Axis { range: Some((low, high)), ..y.clone() },
            series: vec![
                curve("measured", &trace.measured).measured(),
                curve("description", &trace.described).dashed(),
                curve("identified", &trace.identified),
            ],
            bands: Vec::new(),
        }
    };
    let panels: Vec<Figure> = (1..).zip(traces).map(panel).collect();
    stacked(title, &panels, SIZE)
}

/// The measured range with half as much around it. A description without friction is often far
/// away, and would hide the rest.
fn range(measured: &[f64]) -> (f64, f64) {
    let low = measured.iter().copied().fold(f64::INFINITY, f64::min);
    let high = measured.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let around = 0.5 * (high - low).max(1e-6);
    (low - around, high + around)
}
