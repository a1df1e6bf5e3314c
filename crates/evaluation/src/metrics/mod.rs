//! Metrics of predictions: their errors, and the quality of their uncertainty.
//!
//! Positions are given in rad. Errors of positions are in degrees, like the paper's figures, and
//! errors of torques in N·m.

mod band;
mod continuity;
mod crps;
mod energy_score;
mod interval;
mod jitter;
mod limits;
#[cfg(test)]
pub(crate) mod normal;
mod rmse;
mod torque;

pub use band::{highest_component_hz, occupied_band_hz};
pub use jitter::band_edge_hz;
pub use rmse::rmse_deg;

pub(crate) use continuity::continuity;
pub(crate) use crps::crps;
pub(crate) use energy_score::energy_score;
pub(crate) use interval::{central_interval, least_samples};
pub(crate) use jitter::JitterMeter;
pub(crate) use limits::{beyond_limits_deg, has_diverged};
pub(crate) use rmse::{joint_rmse_deg, squares_deg2};
pub(crate) use torque::{torque_rmse_nm, torques_of_arm};
