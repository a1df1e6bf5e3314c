//! References: the joint motions that a controller makes the arm follow.
//!
//! Every reference lies within the limits of the robot's description. `reach` says how much of each
//! joint's range it uses, and `speed` how much of its speed.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::control_law::has_orientation;
use super::excitation::Frequency;
use crate::Range;
use crate::check::{Check, Violations};

/// A Fourier series of each joint, r(t) = c + Σ (a_k sin 2πkft + b_k cos 2πkft), k from 1 to
/// `harmonics`. a_k and b_k are drawn from [-1, 1] / k, and then scaled to the reach and the speed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FourierSeries {
    /// f, the frequency of the first harmonic.
    pub frequency_hz: Frequency,
    /// Number of harmonics.
    #[serde(default = "defaults::harmonics")]
    pub harmonics: u32,
    /// Share of each joint's range, on both sides of `initial_state.center_rad`, that references
    /// stay within.
    #[serde(default = "defaults::reach")]
    pub reach: f64,
    /// Interval of the largest speed, as a share of each joint's limit. A trajectory draws one
    /// share, and each of its joints uses half of it to all of it.
    #[serde(default = "defaults::speed")]
    pub speed: Range,
}

/// Moves from one random posture to the next, with a rest in between. All joints start and stop
/// together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PointToPointMoves {
    /// Moves per second.
    pub frequency_hz: Frequency,
    /// The course of a move.
    #[serde(default)]
    pub profile: MoveProfile,
    /// Share of the time between two starts that the arm moves. It rests for the remaining time.
    #[serde(default = "defaults::moving")]
    pub moving: f64,
    /// Share of each joint's range, on both sides of `initial_state.center_rad`, that postures lie
    /// within.
    #[serde(default = "defaults::reach")]
    pub reach: f64,
    /// Interval of the largest speed, as a share of each joint's limit; a trajectory draws one
    /// share. A joint whose next position is too far away for it stops earlier.
    #[serde(default = "defaults::speed")]
    pub speed: Range,
}

/// The course of a move over its duration T, from 0 to 1 of its distance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MoveProfile {
    /// 10 s³ − 15 s⁴ + 6 s⁵ with s = t / T (Flash and Hogan 1985). Its largest speed is 1.875 / T.
    #[default]
    MinimumJerk,
    /// Constant acceleration for a third of T, constant speed for a third, and constant
    /// deceleration. Its largest speed is 1.5 / T.
    Trapezoid,
}

/// A smooth motion past random postures without a stop: the uniform cubic B-spline whose control
/// points are the postures. It has continuous accelerations, and lies within the postures' range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ViaPoints {
    /// Postures per second.
    pub frequency_hz: Frequency,
    /// Share of each joint's range, on both sides of `initial_state.center_rad`, that postures lie
    /// within.
    #[serde(default = "defaults::reach")]
    pub reach: f64,
    /// Interval of the largest speed, as a share of each joint's limit; a trajectory draws one
    /// share. Postures that are too far apart for it are brought closer.
    #[serde(default = "defaults::speed")]
    pub speed: Range,
}

/// Paths of the hand about a random place: circles, spirals and lines, in a plane of random
/// direction. The joints follow by differential inverse kinematics of the nominal arm. The hand
/// keeps its orientation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct HandPaths {
    /// Turns per second; of a line, strokes there and back.
    pub frequency_hz: Frequency,
    /// The shapes. Each trajectory draws one of them, all with the same probability.
    #[serde(default = "defaults::shapes")]
    pub shapes: Vec<PathShape>,
    /// Interval of the radius, or of half a line's length, m. It is halved until all joints keep
    /// their limits.
    #[serde(default = "defaults::radius_m")]
    pub radius_m: Range,
    /// Share of each joint's range, on both sides of `initial_state.center_rad`, that the posture
    /// at the start lies within.
    #[serde(default = "defaults::hand_reach")]
    pub reach: f64,
    /// The largest speed of a joint, as a share of its limit.
    #[serde(default = "defaults::hand_speed")]
    pub speed: f64,
    /// Whether the hand keeps its orientation. Default: whether the arm has six joints at least.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orientation: Option<bool>,
}

/// The shape of a hand's path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PathShape {
    /// A circle.
    Circle,
    /// A circle whose radius shrinks to a fifth and grows again, within five turns.
    Spiral,
    /// A line, there and back with a sine's speed.
    Line,
}

impl PathShape {
    /// All shapes.
    pub const ALL: [Self; 3] = [Self::Circle, Self::Spiral, Self::Line];
}

impl HandPaths {
    /// Whether the hand of an arm of `joints` joints keeps its orientation.
    pub fn keeps_orientation(&self, joints: usize) -> bool {
        has_orientation(self.orientation, joints)
    }
}

/// The smallest radius of a hand's path, m, as drawn. It may be halved further.
const LEAST_RADIUS_M: f64 = 0.001;

impl Check for HandPaths {
    fn check(&self, violations: &mut Violations) {
        violations.length("shapes", self.shapes.len(), 1..=PathShape::ALL.len());
        violations.no_duplicates("shapes", &self.shapes);
        violations.interval("radius_m", self.radius_m, &(LEAST_RADIUS_M..=5.0));
        violations.within("reach", self.reach, LEAST_SHARE..=1.0);
        violations.within("speed", self.speed, LEAST_SHARE..=1.0);
    }
}

/// References use at least this share of a range or of a speed.
const LEAST_SHARE: f64 = 0.001;

fn check_shares(reach: f64, speed: Range, violations: &mut Violations) {
    violations.within("reach", reach, LEAST_SHARE..=1.0);
    violations.interval("speed", speed, &(LEAST_SHARE..=1.0));
}

impl Check for FourierSeries {
    fn check(&self, violations: &mut Violations) {
        violations.within("harmonics", self.harmonics, 1..=20);
        check_shares(self.reach, self.speed, violations);
    }
}

impl Check for PointToPointMoves {
    fn check(&self, violations: &mut Violations) {
        violations.within("moving", self.moving, 0.05..=1.0);
        check_shares(self.reach, self.speed, violations);
    }
}

impl Check for ViaPoints {
    fn check(&self, violations: &mut Violations) {
        check_shares(self.reach, self.speed, violations);
    }
}

mod defaults {
    use crate::Range;

    /// As many as the exciting trajectories of the literature have (Swevers et al. 1997).
    pub const fn harmonics() -> u32 {
        5
    }
    pub const fn reach() -> f64 {
        0.5
    }
    pub const fn speed() -> Range {
        Range::new(0.1, 0.5)
    }
    pub const fn moving() -> f64 {
        0.8
    }
    pub fn shapes() -> Vec<super::PathShape> {
        super::PathShape::ALL.to_vec()
    }
    pub const fn radius_m() -> Range {
        Range::new(0.05, 0.15)
    }
    /// The joints move beyond it while the hand is on its path.
    pub const fn hand_reach() -> f64 {
        0.25
    }
    pub const fn hand_speed() -> f64 {
        0.5
    }
}
