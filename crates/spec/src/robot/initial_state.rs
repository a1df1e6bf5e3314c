use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Range;

/// How the state at t = 0 is drawn (source: the paper's code). With a controller, the arm starts on
/// its reference, and only `center_rad` is used.
///
/// q1 = k·(±1)·U(q1min, q1max) with k from `joint1_scale`. q2, q3, .. = center + s·spread·U(0, 1)
/// with one sign s for all. Velocities: g from `velocity_scale`; q̇1 = g·(±1)·joint1_velocity·U(0,
/// 1); q̇2, q̇3, .. = g·s'·velocity·U(0, 1) with one sign s' for all. Positions are in rad, and
/// velocities in rad/s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitialState {
    /// Interval of k.
    pub joint1_scale: Range,
    /// Centers of all joints. That of joint 1 is used only by references, which lie about these
    /// centers.
    pub center_rad: Vec<f64>,
    /// The largest distance from the center, rad.
    pub spread_rad: f64,
    /// Interval of g.
    pub velocity_scale: Range,
    /// The largest speed of joint 1 at g = 1, rad/s.
    pub joint1_velocity_rad_s: f64,
    /// The largest speed of the other joints at g = 1, rad/s.
    pub velocity_rad_s: f64,
}

#[expect(clippy::approx_constant, reason = "the paper's code rounds -π/2 to four digits")]
impl Default for InitialState {
    fn default() -> Self {
        Self {
            joint1_scale: Range::new(0.2, 0.8),
            center_rad: vec![0.0, 0.0, 0.0, -1.5708, 0.0, 1.8675, 0.0],
            spread_rad: 0.25,
            velocity_scale: Range::new(0.2, 0.8),
            joint1_velocity_rad_s: 0.5,
            velocity_rad_s: 2.0,
        }
    }
}
