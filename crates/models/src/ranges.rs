//! The ranges of a model's training data, and warnings for questions outside of them.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use series::{Observed, SeriesView, Track};
use spec::{Given, Range};
use wire::{Warning, WarningKind};

/// A value counts as outside if it lies beyond its range by more than this share of the range's
/// width. The extremes of new robots of the same kind lie a little beyond those of a training.
const TOLERANCE: f64 = 0.05;

/// It must also lie beyond by more than this, N·m, rad or rad/s. A joint that never moved in
/// training has a range of no width.
const LEAST_BEYOND: f64 = 1e-3;

/// Positions are in f32, so one that stays at a limit may lie this far beyond it, rad.
pub const POSITION_ROUNDING_RAD: f64 = 1e-5;

/// A context in which every joint moves less than this identifies nothing, rad: 0.06°.
const LEAST_MOTION_RAD: f64 = 1e-3;

/// Shorter contexts hardly identify a robot, samples. Inertia shows in second differences, each of
/// which needs three samples, and each joint has about as many unknowns.
const FEWEST_SAMPLES: u32 = 10;

/// Smallest and largest value of each joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataRanges {
    /// Torques, N·m. Where a model is given references, these are references, rad.
    pub u_nm: Vec<Range>,
    /// Positions, rad.
    pub y_rad: Vec<Range>,
    /// Differences of neighbouring positions over the sampling time, rad/s.
    pub rate_rad_s: Vec<Range>,
    /// The signals that the model is given.
    #[serde(default, skip_serializing_if = "Given::is_torques")]
    pub given: Given,
}

impl DataRanges {
    /// The ranges of all robots and samples; `None` without any.
    pub fn of(data: &SeriesView<'_>) -> Option<Self> {
        let of = |robot| Self::of_tracks(data.u(robot), data.y(robot), data.rate_hz());
        (0..data.robots()).into_par_iter().map(of).reduce_with(Self::and)
    }

    fn of_tracks(u: Track<'_>, y: Track<'_>, rate_hz: f64) -> Self {
        let joints = u.joints();
        let (u, y) = (u.values(), y.values());
        let after = y.get(joints..).unwrap_or_default();
        let steps = Ends::of(joints, after, |block, first| {
            for (value, &before) in block.iter_mut().zip(&y[first..]) {
                *value -= f64::from(before);
            }
        });
        Self {
            u_nm: Ends::of(joints, u, |_, _| ()).ranges(1.0),
            y_rad: Ends::of(joints, y, |_, _| ()).ranges(1.0),
            rate_rad_s: steps.ranges(rate_hz),
            given: Given::Torques,
        }
    }

    /// The same ranges of a model that is given something else.
    #[must_use]
    pub(crate) fn given(self, given: Given) -> Self {
        Self { given, ..self }
    }

    /// The ranges of both together, in either order.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        let both = |ours: Vec<Range>, theirs: Vec<Range>| {
            let wider = |(a, b): (Range, Range)| Range::new(a.min.min(b.min), a.max.max(b.max));
            ours.into_iter().zip(theirs).map(wider).collect()
        };
        Self {
            u_nm: both(self.u_nm, other.u_nm),
            y_rad: both(self.y_rad, other.y_rad),
            rate_rad_s: both(self.rate_rad_s, other.rate_rad_s),
            given: self.given,
        }
    }

    /// Whether these are valid ranges of an arm of `joints` joints.
    pub(crate) fn is_usable(&self, joints: usize) -> bool {
        let each = [&self.u_nm, &self.y_rad, &self.rate_rad_s];
        each.iter().all(|ranges| ranges.len() == joints)
            && each.iter().flat_map(|ranges| ranges.iter()).all(|range| {
                range.min.is_finite() && range.max.is_finite() && range.min <= range.max
            })
    }

    /// A warning for each quantity and joint that lies outside: torques of context and horizon,
    /// positions of the context, and their rates.
    pub fn warnings(&self, observed: &Observed<'_>) -> Vec<Warning> {
        let of = |robot| {
            let (u, y) = (observed.u(robot), observed.y(robot));
            self.warnings_of(&Self::of_tracks(u, y, observed.rate_hz()))
        };
        Warning::merge((0..observed.robots()).flat_map(of))
    }

    /// The warnings for one robot, whose data has the ranges `found`.
    pub fn warnings_of(&self, found: &Self) -> Vec<Warning> {
        let of_given = match self.given {
            Given::Torques => WarningKind::TorqueRange,
            Given::References => WarningKind::ReferenceRange,
        };
        let quantities = [
            (of_given, &self.u_nm, &found.u_nm),
            (WarningKind::PositionRange, &self.y_rad, &found.y_rad),
            (WarningKind::RateRange, &self.rate_rad_s, &found.rate_rad_s),
        ];
        let mut warnings = Vec::new();
        for (kind, trained, found) in quantities {
            for ((trained, found), joint) in trained.iter().zip(found).zip(1..) {
                if let Some(reached) = outside(*trained, *found) {
                    warnings.push(Warning::outside(kind, joint, reached, *trained, 1));
                }
            }
        }
        warnings
    }
}

/// Samples that are compared side by side, because training does this for every batch.
const SIDE_BY_SIDE: usize = 8;

/// Smallest and largest value of each joint.
struct Ends(Vec<[f64; 2]>);

impl Ends {
    /// The ends of `values` `[sample, joint]`, after `change` of some neighbouring values. `change`
    /// also gets the index of the first one.
    fn of(joints: usize, values: &[f32], change: impl Fn(&mut [f64], usize)) -> Self {
        let length = SIDE_BY_SIDE * joints;
        let mut least = vec![f64::INFINITY; length];
        let mut largest = vec![f64::NEG_INFINITY; length];
        let mut changed = Vec::with_capacity(length);
        for (index, values) in values.chunks(length).enumerate() {
            changed.clear();
            changed.extend(values.iter().map(|&value| f64::from(value)));
            change(&mut changed, index * length);
            for ((least, largest), &value) in least.iter_mut().zip(&mut largest).zip(&changed) {
                *least = least.min(value);
                *largest = largest.max(value);
            }
        }
        let of_joint = |joint: usize| {
            let least = least[joint..].iter().step_by(joints).copied();
            let largest = largest[joint..].iter().step_by(joints).copied();
            [least.fold(f64::INFINITY, f64::min), largest.fold(f64::NEG_INFINITY, f64::max)]
        };
        Self((0..joints).map(of_joint).collect())
    }

    /// The ranges times `scale`; 0 without values. Adding 0 turns -0 into 0, so that the order of
    /// the values does not matter.
    fn ranges(&self, scale: f64) -> Vec<Range> {
        let end = |value: f64| if value.is_finite() { scale * value + 0.0 } else { 0.0 };
        self.0.iter().map(|&[least, largest]| Range::new(end(least), end(largest))).collect()
    }
}

/// Warnings for contexts that identify nothing, because they are too short or nothing moves in
/// them.
pub fn context_warnings(observed: &Observed<'_>) -> Vec<Warning> {
    let samples = u32::try_from(observed.context()).unwrap_or(u32::MAX);
    if samples < FEWEST_SAMPLES {
        let scenarios = observed.robots() as u64;
        return vec![Warning::short_context(samples, FEWEST_SAMPLES, scenarios)];
    }
    let is_still = |robot: &usize| {
        let y = observed.y(*robot);
        let of_joint = |joint| range(y.joint(joint).map(f64::from));
        (0..y.joints()).map(of_joint).all(|range| range.max - range.min <= LEAST_MOTION_RAD)
    };
    let still = (0..observed.robots()).filter(is_still).count() as u64;
    if still > 0 { vec![Warning::no_motion(LEAST_MOTION_RAD, still)] } else { Vec::new() }
}

/// Warnings for predicted positions beyond the limits of a joint. `positions` are `[sample, robot,
/// horizon, joint]` in rad, of `robots` robots. Every sample counts.
pub fn limit_warnings(
    positions: &[f32],
    robots: usize,
    horizon: usize,
    limits_rad: &[Range],
) -> Vec<Warning> {
    let joints = limits_rad.len();
    let row = (horizon * joints).max(1);
    let of_robot = |robot: usize| {
        let of_joint = move |((joint, limits), number): ((usize, &Range), u32)| {
            let rows = positions.chunks_exact(row).skip(robot).step_by(robots);
            let values = rows.flat_map(|row| row.iter().skip(joint).step_by(joints));
            let found = range(values.map(|&q| f64::from(q)));
            let reached = furthest(*limits, found);
            let allowed =
                Range::new(limits.min - POSITION_ROUNDING_RAD, limits.max + POSITION_ROUNDING_RAD);
            (!allowed.contains(reached))
                .then(|| Warning::outside(WarningKind::JointLimits, number, reached, *limits, 1))
        };
        limits_rad.iter().enumerate().zip(1..).filter_map(of_joint)
    };
    Warning::merge((0..robots).flat_map(of_robot))
}

/// The value of `found` that lies furthest outside of `trained`, if it counts.
fn outside(trained: Range, found: Range) -> Option<f64> {
    let tolerance = (TOLERANCE * (trained.max - trained.min)).max(LEAST_BEYOND);
    let wider = Range::new(trained.min - tolerance, trained.max + tolerance);
    let reached = furthest(trained, found);
    (!wider.contains(reached)).then_some(reached)
}

/// The end of `found` that lies further outside of `range`, or less far inside it.
fn furthest(range: Range, found: Range) -> f64 {
    if range.min - found.min > found.max - range.max { found.min } else { found.max }
}

/// From the smallest value to the largest; 0 without values.
fn range(values: impl Iterator<Item = f64>) -> Range {
    let ends = |ends: Option<Range>, value: f64| {
        let ends = ends.unwrap_or(Range::new(value, value));
        Some(Range::new(ends.min.min(value), ends.max.max(value)))
    };
    values.fold(None, ends).unwrap_or(Range::new(0.0, 0.0))
}

#[cfg(test)]
mod tests {
    use series::{Series, Shape};

    use super::*;

    const JOINTS: usize = 2;

    /// One robot whose joints swing by `q` rad, under torques of up to `u` N·m.
    fn robot(u: f32, q: f32, samples: usize) -> Series {
        let swing = |size: f32| -> Vec<f32> {
            let at = |k: usize| (0.3 * (k / JOINTS) as f32).sin() * size;
            (0..samples * JOINTS).map(at).collect()
        };
        let shape = Shape { robots: 1, samples, joints: JOINTS };
        Series::new(shape, 60.0, swing(u), swing(q)).unwrap()
    }

    fn trained() -> DataRanges {
        DataRanges::of(&robot(2.8, 1.0, 60).view()).unwrap()
    }

    #[test]
    fn torques_positions_and_rates_outside_are_told_with_both_numbers() {
        let trained = trained();
        assert!((trained.u_nm[0].max - 2.8).abs() < 0.02, "{trained:?}");
        // 0.3 rad per sample at 60 Hz.
        assert!((trained.rate_rad_s[1].max - 18.0).abs() < 0.5, "{trained:?}");
        assert_eq!(trained.warnings(&robot(2.8, 1.0, 60).observed(40)), []);
        let kinds = |u: f32, q: f32| -> Vec<(WarningKind, u32)> {
            let warnings = trained.warnings(&robot(u, q, 60).observed(40));
            warnings.iter().map(|warning| (warning.kind, warning.joint.unwrap())).collect()
        };
        assert_eq!(
            kinds(30.0, 1.0),
            [(WarningKind::TorqueRange, 1), (WarningKind::TorqueRange, 2)]
        );
        let moved = [WarningKind::PositionRange, WarningKind::RateRange];
        assert_eq!(kinds(2.8, 1.5), moved.map(|kind| [(kind, 1), (kind, 2)]).concat());
        let message = &trained.warnings(&robot(30.0, 1.0, 60).observed(40))[0].message;
        assert!(message.ends_with("trained on -2.79 to 2.80 N·m"), "{message}");
    }

    #[test]
    fn a_little_beyond_the_range_is_no_warning() {
        // The range is 5.6 N·m wide. A twentieth of it is 0.28.
        assert_eq!(trained().warnings(&robot(3.0, 1.0, 60).observed(40)), []);
        assert_eq!(trained().warnings(&robot(3.2, 1.0, 60).observed(40)).len(), 2);
    }

    #[test]
    fn torques_of_the_horizon_count_and_its_positions_are_not_seen() {
        let mut series = robot(2.8, 1.0, 60);
        let u: Vec<f32> =
            series.u().iter().enumerate().map(|(k, u)| if k == 111 { -30.1 } else { *u }).collect();
        let y: Vec<f32> =
            series.y().iter().enumerate().map(|(k, y)| if k == 111 { 9.0 } else { *y }).collect();
        series = Series::new(series.shape(), 60.0, u, y).unwrap();
        let found = trained().warnings(&series.observed(40));
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].joint, found[0].reached), (Some(2), Some(f64::from(-30.1_f32))));
    }

    #[test]
    fn the_order_of_batches_does_not_show() {
        let parts = [robot(1.0, 0.3, 60), robot(2.0, 0.1, 60), robot(0.5, 0.9, 60)];
        let ranges: Vec<DataRanges> =
            parts.iter().map(|part| DataRanges::of(&part.view()).unwrap()).collect();
        let forwards = ranges.iter().cloned().reduce(DataRanges::and);
        let backwards = ranges.into_iter().rev().reduce(DataRanges::and);
        assert_eq!(forwards, backwards);
    }

    #[test]
    fn a_context_that_tells_nothing_is_told_of() {
        assert_eq!(context_warnings(&robot(2.8, 1.0, 60).observed(40)), []);
        let still = context_warnings(&robot(2.8, 4e-4, 60).observed(40));
        assert_eq!(still[0].kind, WarningKind::NoMotion);
        let short = context_warnings(&robot(2.8, 1.0, 60).observed(9));
        assert_eq!((short[0].kind, short[0].reached), (WarningKind::ShortContext, Some(9.0)));
    }

    #[test]
    fn a_prediction_beyond_a_limit_is_told_of_by_robot_and_joint() {
        let limits = [Range::new(-1.0, 1.0), Range::new(-2.0, 0.0)];
        // Two samples of two robots over a horizon of 1.
        let positions = [0.0, -1.0, 0.5, -1.0, 0.0, 0.4, 0.5, -1.0];
        let found = limit_warnings(&positions, 2, 1, &limits);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].joint, found[0].scenarios), (Some(2), 1));
        assert_eq!(found[0].range, Some(limits[1]));
        assert_eq!(limit_warnings(&positions, 2, 1, &[]), []);
    }
}
