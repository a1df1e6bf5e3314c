//! Sentences about motions and torques beyond the limits of a description.

use super::comparison::Comparison;
use super::limits::Reached;
use super::purpose::{BEYOND, Purpose};
use super::told::{Doubt, Kind};
use crate::wording::digits;

/// How far a position may be beyond its limit, rad.
const BEYOND_RAD: f64 = 0.05;

/// Positions and speeds that the description does not allow, in columns that look like those of their
/// joints.
pub fn of_motion(found: &Comparison, doubts: &mut Vec<Doubt>) {
    let Comparison { layout, ties, .. } = found;
    let is_as_declared = |joint: usize| {
        layout.positions[joint].0 == joint
            && layout.has_declared_sign(joint)
            && !ties.signs.contains(&joint)
    };
    let joints = || found.farthest.iter().enumerate().filter(|(joint, _)| is_as_declared(*joint));
    let positions = joints().filter(|(_, farthest)| farthest.beyond_rad > BEYOND_RAD);
    let positions = positions.map(|(joint, farthest)| (joint, &farthest.position));
    doubts.extend(beyond(Kind::Position, positions, |list| {
        format!(
            "q goes beyond the limits of the robot: {list}. Are the unit of angles, the zero positions and the order of \
             the joints those of the robot?"
        )
    }));
    let speeds = joints().filter(|(_, farthest)| farthest.speed.share() > BEYOND);
    let speeds = speeds.map(|(joint, farthest)| (joint, &farthest.speed));
    doubts.extend(beyond(Kind::Speed, speeds, |list| {
        format!(
            "the speed goes beyond the limits of the robot: {list}. Are the unit of angles and the rate of the rows right?"
        )
    }));
}

/// Torques that the description does not allow, in columns that look like those of their joints.
pub fn of_torques(found: &Comparison, purpose: Purpose, doubts: &mut Vec<Doubt>) {
    let is_doubtful = |joint: usize, torque: &Reached| {
        found.layout.torques[joint] == joint && torque.share() > purpose.doubtful_torque()
    };
    let torques = found.farthest.iter().map(|farthest| &farthest.torque).enumerate();
    let torques = torques.filter(|(joint, torque)| is_doubtful(*joint, torque));
    doubts.extend(beyond(Kind::Torque, torques, |list| {
        format!(
            "u goes beyond the limits of the robot: {list}. Are the unit of u and the order of the joints those of the \
             robot?"
        )
    }));
}

/// A doubt with a list such as `joint 3 reaches 3.1 of 2.9 rad (12.3 s into a.csv)`. `None` without
/// any joint.
fn beyond<'a>(
    kind: Kind,
    joints: impl Iterator<Item = (usize, &'a Reached)>,
    sentence: impl Fn(&str) -> String,
) -> Option<Doubt> {
    let unit = match kind {
        Kind::Position => "rad",
        Kind::Speed => "rad/s",
        _ => "N·m",
    };
    let joints: Vec<(usize, &Reached)> = joints.collect();
    let of_joint = |(joint, reached): &(usize, &Reached)| {
        let Reached { value, limit, .. } = reached;
        let place = reached.place();
        format!(
            "joint {} reaches {} of {} {unit} ({place})",
            joint + 1,
            digits(*value),
            digits(*limit)
        )
    };
    let list: Vec<String> = joints.iter().map(of_joint).collect();
    let size = joints.iter().map(|(_, reached)| reached.share()).fold(0.0, f64::max);
    let text = sentence(&list.join(", "));
    let joints: Vec<usize> = joints.into_iter().map(|(joint, _)| joint).collect();
    (!joints.is_empty()).then_some(Doubt { kind, joints, size, text })
}
