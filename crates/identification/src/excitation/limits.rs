//! The limits of a motion, and how far a state is from them.

use dynamics::{Joints, Kinematics};
use nalgebra::{RowVector3, Vector3};
use spec::RobotDescription;

use super::error::ExcitationError;
use super::settings::ExcitationSettings;
use crate::arm::Arm;

/// Limits within the margin. A state is allowed while every share of a limit is within ±1, and every
/// height is above the floor.
pub(crate) struct Limits {
    /// The middle of each joint's positions, and half of their width, rad.
    pub(crate) middle: Joints<f64>,
    pub(crate) half: Joints<f64>,
    /// rad/s.
    pub(crate) velocity: Joints<f64>,
    /// rad/s².
    pub(crate) acceleration: Joints<f64>,
    /// For all torques but Coulomb friction, N·m. Its full size is taken off, whatever its direction.
    pub(crate) torque: Joints<f64>,
    /// The least height of the origins in the world, m.
    pub(crate) floor_m: Option<f64>,
}

/// The least room of a joint, rad.
const LEAST_ROOM_RAD: f64 = 0.05;

/// The time in which a joint reaches its highest speed, if accelerations are not given, s.
pub(crate) const TIME_TO_FULL_SPEED_S: f64 = 0.5;

impl Limits {
    /// # Errors
    /// When a joint has no room, or friction takes its whole torque.
    pub(crate) fn of(
        description: &RobotDescription,
        arm: &Arm,
        settings: &ExcitationSettings,
    ) -> Result<Self, ExcitationError> {
        let margin = settings.margin;
        let kept = 1.0 - margin;
        let joints = description.joints.len();
        let zero = Joints::splat(joints, 0.0);
        let floor_m = settings.table_z_m.map(|table| table + settings.clearance_m);
        let mut limits = Self {
            middle: zero,
            half: zero,
            velocity: zero,
            acceleration: zero,
            torque: zero,
            floor_m,
        };
        for (index, joint) in description.joints.iter().enumerate() {
            let (range, name) = (joint.position_rad, joint.name.clone());
            let room_rad = kept * (range.max - range.min);
            if room_rad < LEAST_ROOM_RAD {
                let least_rad = LEAST_ROOM_RAD;
                return Err(ExcitationError::Room { index, name, room_rad, margin, least_rad });
            }
            let coulomb_nm = arm.coulomb_nm(index);
            if kept * joint.torque_nm <= coulomb_nm {
                let (torque_nm, least_nm) = (joint.torque_nm, coulomb_nm / kept);
                return Err(ExcitationError::Friction { index, name, torque_nm, margin, least_nm });
            }
            limits.middle[index] = 0.5 * (range.min + range.max);
            limits.half[index] = 0.5 * room_rad;
            limits.velocity[index] = kept * joint.velocity_rad_s;
            limits.acceleration[index] = kept
                * settings
                    .accelerations_rad_s2
                    .as_ref()
                    .map_or(joint.velocity_rad_s / TIME_TO_FULL_SPEED_S, |all| all[index]);
            limits.torque[index] = kept * joint.torque_nm - coulomb_nm;
        }
        Ok(limits)
    }

    /// The same limits, closer by a share.
    pub(crate) fn tightened(&self, share: f64) -> Self {
        const FLOOR_M: f64 = 0.1;

        let kept = |values: &Joints<f64>| values.map(|value| (1.0 - share) * value);
        Self {
            middle: self.middle,
            half: kept(&self.half),
            velocity: kept(&self.velocity),
            acceleration: kept(&self.acceleration),
            torque: kept(&self.torque),
            floor_m: self.floor_m.map(|floor| floor + share * FLOOR_M),
        }
    }
}

/// Heights in the world of the frames' origins from the third joint on, and of the hand's, m. The
/// straight lines between them are as high, because the table is flat.
pub(crate) fn heights(kinematics: &Kinematics, q: &Joints<f64>, heights: &mut Vec<f64>) {
    heights.clear();
    let mut height = kinematics.base.position_m[2];
    let mut down = RowVector3::from(kinematics.base.rotation[2]);
    for (joint, row) in kinematics.joints.iter().enumerate() {
        height += (down * Vector3::from(row.origin())).x;
        if joint >= 2 {
            heights.push(height);
        }
        down *= row.turn(q[joint]).matrix();
    }
    heights.push(height + (down * Vector3::from(kinematics.hand.origin())).x);
}

#[cfg(test)]
mod tests {
    use dynamics::{Base, Robot};

    use super::*;

    #[test]
    fn the_last_height_is_the_hands() {
        let mut kinematics = Robot::panda().kinematics;
        kinematics.base = Base::new([0.1, 0.2, 0.3], [30.0, -50.0, 20.0]);
        let q = Joints::from_fn(7, |joint| 0.3 * joint as f64 - 0.8);
        let mut all = Vec::new();
        heights(&kinematics, &q, &mut all);
        assert_eq!(all.len(), 6);
        let [_, _, hand] = kinematics.end_effector_pose(q).position_m;
        assert!((all[5] - hand).abs() < 1e-12);
    }
}
