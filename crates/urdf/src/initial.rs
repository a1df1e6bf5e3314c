//! Where motions of an arm begin.

use spec::{InitialState, Range};

use crate::document::Joint;
use crate::limits::Limits;
use crate::part::Doubts;

/// Largest share of the way from 0 to the nearer limit at which the first joint begins.
const SHARE: Range = Range::new(0.2, 0.8);
/// Largest spread of the other joints, rad.
const SPREAD_RAD: f64 = 0.25;
/// Largest share of a range of positions, to either side of its middle, that the spread takes.
const SPREAD_SHARE: f64 = 0.25;
/// Farthest center that a description may have, rad.
const MAX_CENTER_RAD: f64 = 4.0;
/// Largest speeds, rad/s.
const JOINT1_VELOCITY_RAD_S: f64 = 0.5;
const VELOCITY_RAD_S: f64 = 2.0;

/// The Panda's law of initial states, within these limits.
///
/// Joints begin around the middle of their ranges, at most 0.25 rad and a quarter of the range
/// away. The first begins on either side of 0, between 0.2 and 0.8 of the nearer limit. Speeds are
/// at most the Panda's, and at most four fifths of the limits.
pub(crate) fn initial_state(
    joints: &[&Joint],
    limits: &[Limits],
    doubts: &mut Doubts,
) -> InitialState {
    let first = limits[0].position_rad;
    let least = |values: &mut dyn Iterator<Item = f64>, most| values.fold(most, f64::min);
    // Positions of joint 1 are those of its range times a share, with any sign.
    let nearer = first.max.min(0.0 - first.min).max(0.0);
    let share = nearer / first.max.max(-first.min);
    if nearer == 0.0 {
        doubts.joint(
            &joints[0].name,
            format!(
                "motions of the first joint begin on both sides of 0, but its positions are {} to {} rad: \
                 widen `position_rad`, or lock the joint",
                first.min, first.max
            ),
        );
    }
    let centers = joints.iter().zip(limits).map(|(joint, limits)| {
        let range = limits.position_rad;
        let middle = range.at(0.5);
        let center = middle.clamp(-MAX_CENTER_RAD, MAX_CENTER_RAD);
        if center != middle {
            doubts.joint(
                &joint.name,
                format!(
                    "the middle of its positions is {middle:.4} rad: motions begin around {center}"
                ),
            );
        }
        center
    });
    let center_rad = centers.collect();
    let mut spreads = limits
        .iter()
        .map(|limits| SPREAD_SHARE * (limits.position_rad.max - limits.position_rad.min));
    let mut speeds = limits.iter().skip(1).map(|limits| limits.velocity_rad_s);
    InitialState {
        joint1_scale: Range::new(SHARE.min * share, SHARE.max * share),
        center_rad,
        spread_rad: least(&mut spreads, SPREAD_RAD),
        velocity_scale: SHARE,
        joint1_velocity_rad_s: JOINT1_VELOCITY_RAD_S.min(limits[0].velocity_rad_s),
        velocity_rad_s: least(&mut speeds, VELOCITY_RAD_S),
    }
}
