//! Paths of joints.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::{JointDescription, MAX_JOINTS, Range, RobotDescription, RobotModel};

/// Smallest distance of a path to a joint's limit from any start, rad.
const CLEARANCE_RAD: f64 = 0.1;

/// Desired joint positions over time. The path begins at rest, at the robot's position when control
/// begins. Each joint moves towards the limit that is farther away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ControlPath {
    /// Goes there and back, again and again.
    Swing(Swing),
    /// Goes to another place and rests there.
    PointToPoint(PointToPoint),
}

/// q(t) = q(0) ± a (1 − cos 2πft) / 2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Swing {
    /// a of each joint, rad. Default: as far as the joint's free range allows, at most 0.4 rad.
    pub amplitude_rad: Vec<f64>,
    /// f of each joint, Hz. Default: 0.15 to 0.3.
    pub frequency_hz: Vec<f64>,
}

/// q(t) = q(0) ± d (10 s³ − 15 s⁴ + 6 s⁵) with s = t / T up to T. It has minimum jerk (Flash and
/// Hogan 1985, "The coordination of arm movements").
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PointToPoint {
    /// d of each joint, rad.
    pub displacement_rad: Vec<f64>,
    /// T, s.
    pub duration_s: f64,
}

impl Default for ControlPath {
    fn default() -> Self {
        Self::Swing(Swing::default())
    }
}

impl Default for Swing {
    fn default() -> Self {
        Self::of(RobotModel::panda().description())
    }
}

impl Swing {
    /// The default path for `robot`. For a Panda, the torques that q̇ = u / D needs for it lie
    /// within those of the training set D1.
    pub(super) fn of(robot: &RobotDescription) -> Self {
        const AMPLITUDE_RAD: f64 = 0.4;
        const FREQUENCY_HZ: [f64; MAX_JOINTS] = [0.15, 0.2, 0.25, 0.15, 0.2, 0.25, 0.3, 0.15];
        let frequency_hz = FREQUENCY_HZ.into_iter().take(robot.joints.len()).collect();
        Self {
            amplitude_rad: robot.per_joint(|joint| AMPLITUDE_RAD.min(free(joint))),
            frequency_hz,
        }
    }
}

/// How far a joint can move from any position within its limits, rad. Half its range is free on one
/// side.
fn free(joint: &JointDescription) -> f64 {
    let Range { min, max } = joint.position_rad;
    0.5 * (max - min) - CLEARANCE_RAD
}

impl ControlPath {
    /// Distance of each joint from its initial position after `t` seconds, rad; not negative.
    pub fn displacement(&self, t: f64) -> Vec<f64> {
        match self {
            Self::Swing(Swing { amplitude_rad, frequency_hz }) => {
                let joints = amplitude_rad.iter().zip(frequency_hz);
                let swung = |(amplitude, frequency): (&f64, &f64)| {
                    0.5 * amplitude * (1.0 - (TAU * frequency * t).cos())
                };
                joints.map(swung).collect()
            }
            Self::PointToPoint(PointToPoint { displacement_rad, duration_s }) => {
                let s = (t / duration_s).clamp(0.0, 1.0);
                let share = s * s * s * (10.0 + s * (6.0 * s - 15.0));
                displacement_rad.iter().map(|displacement| displacement * share).collect()
            }
        }
    }
}

impl ControlPath {
    /// Checks that an arm can follow the path from any start.
    pub(super) fn check_robot(&self, robot: &RobotDescription, violations: &mut Violations) {
        let joints = robot.joints.len();
        let (field, displacement) = match self {
            Self::Swing(Swing { amplitude_rad, frequency_hz }) => {
                violations.one_per_joint("path.swing.frequency_hz", frequency_hz, joints);
                ("path.swing.amplitude_rad", amplitude_rad)
            }
            Self::PointToPoint(PointToPoint { displacement_rad, .. }) => {
                ("path.point-to-point.displacement_rad", displacement_rad)
            }
        };
        violations.one_per_joint(field, displacement, joints);
        for (i, (value, joint)) in displacement.iter().zip(&robot.joints).enumerate() {
            let free = free(joint);
            if *value > free {
                let allowed = format!(
                    "0 to {free:.4}, which keeps the joint within its limits from any start"
                );
                violations.add(&format!("{field}[{i}]"), value, allowed);
            }
        }
    }
}

impl Check for ControlPath {
    fn check(&self, violations: &mut Violations) {
        match self {
            Self::Swing(Swing { amplitude_rad, frequency_hz }) => {
                violations.all_within("swing.amplitude_rad", amplitude_rad, &(0.0..=100.0));
                violations.all_within("swing.frequency_hz", frequency_hz, &(0.001..=100.0));
            }
            Self::PointToPoint(PointToPoint { displacement_rad, duration_s }) => {
                let field = "point-to-point.displacement_rad";
                violations.all_within(field, displacement_rad, &(0.0..=100.0));
                violations.within("point-to-point.duration_s", *duration_s, 0.01..=600.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_begins_at_rest_and_goes_as_far_as_it_says() {
        let point = PointToPoint { displacement_rad: vec![0.7; 7], duration_s: 2.0 };
        for path in [ControlPath::default(), ControlPath::PointToPoint(point.clone())] {
            assert_eq!(path.displacement(0.0), [0.0; 7]);
            assert!(path.displacement(1e-3).iter().all(|value| (0.0..1e-5).contains(value)));
        }
        let there = ControlPath::PointToPoint(point);
        assert!((there.displacement(1.0)[3] - 0.35).abs() < 1e-12);
        assert!((there.displacement(9.0)[3] - 0.7).abs() < 1e-12);
        // Joint 5 moves at 0.2 Hz.
        assert!((ControlPath::default().displacement(2.5)[4] - 0.4).abs() < 1e-12);
    }
}
