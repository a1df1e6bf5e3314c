//! How far a prediction is off, and how well it knows.
//!
//! Positions come in rad; every result is in degrees, as the paper's figures are.

mod band;
mod continuity;
mod crps;
mod energy_score;
mod interval;
mod jitter;
mod limits;
mod low_pass;
#[cfg(test)]
pub(crate) mod normal;
mod rmse;

pub use band::{highest_component_hz, occupied_band_hz};
pub use continuity::{Continuity, continuity};
pub use crps::crps;
pub use energy_score::energy_score;
pub use interval::{central_interval, least_samples};
pub use jitter::{JitterMeter, band_edge_hz};
pub use limits::{DIVERGED_DEG, beyond_limits_deg, has_diverged};
pub use low_pass::LowPass;
pub use rmse::{joint_rmse_deg, rmse_deg, squares_deg2};
