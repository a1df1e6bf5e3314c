use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What is recorded besides torques and joint positions, as further columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Observations {
    /// Joint velocities `qd1` to `qd7`, rad/s.
    pub joint_velocities: bool,
    /// Pose of the hand's frame in the base's: position `ee_x`, `ee_y`, `ee_z` in m and unit
    /// quaternion `ee_qx`, `ee_qy`, `ee_qz`, `ee_qw`, whose sign is continuous in time.
    pub end_effector_pose: bool,
}
