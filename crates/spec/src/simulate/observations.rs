use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};
use crate::omitted::is_zero;

/// Additional recorded quantities, besides torques and joint positions, and measurement noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Observations {
    /// Joint velocities `qd1` to `qd7`, rad/s.
    pub joint_velocities: bool,
    /// Pose of the hand's frame in the base's frame: position `ee_x`, `ee_y`, `ee_z` in m and unit
    /// quaternion `ee_qx`, `ee_qy`, `ee_qz`, `ee_qw`. The quaternion's sign is continuous in time.
    pub end_effector_pose: bool,
    /// Standard deviation of the Gaussian noise of measured positions, rad, 0 to 0.1. Models and
    /// baselines then see `q_measured1`, .., and errors are measured against the positions `q1`, ..
    #[serde(skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// Resolution of the encoders, rad, 0 to 0.1. Measured positions with noise are rounded to
    /// multiples of it. 0 rounds nothing.
    #[serde(skip_serializing_if = "is_zero")]
    pub position_resolution_rad: f64,
    /// Standard deviation of the Gaussian noise of measured torques, N·m, 0 to 100. Models and
    /// baselines then see `u_measured1`, .. in the context. The torques of the horizon are planned
    /// and not measured.
    #[serde(skip_serializing_if = "is_zero")]
    pub torque_noise_nm: f64,
}

/// The largest noise and resolution of positions, rad: 5.7 degrees.
pub const MAX_POSITION_NOISE_RAD: f64 = 0.1;

/// The largest noise of torques, N·m.
const MAX_TORQUE_NOISE_NM: f64 = 100.0;

impl Observations {
    /// Whether measured positions differ from true ones.
    pub fn measures_positions(&self) -> bool {
        self.position_noise_rad > 0.0 || self.position_resolution_rad > 0.0
    }

    /// Whether measured torques differ from true ones.
    pub fn measures_torques(&self) -> bool {
        self.torque_noise_nm > 0.0
    }

    /// Standard deviation of the error of a measured position, rad. Rounding to multiples of r has
    /// an error with standard deviation r / √12.
    pub fn position_deviation_rad(&self) -> f64 {
        self.position_noise_rad.hypot(self.position_resolution_rad / 12.0_f64.sqrt())
    }
}

impl Check for Observations {
    fn check(&self, violations: &mut Violations) {
        let position = 0.0..=MAX_POSITION_NOISE_RAD;
        violations.within("position_noise_rad", self.position_noise_rad, position.clone());
        violations.within("position_resolution_rad", self.position_resolution_rad, position);
        violations.within("torque_noise_nm", self.torque_noise_nm, 0.0..=MAX_TORQUE_NOISE_NM);
    }
}
