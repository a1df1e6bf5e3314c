//! Metrics of predictions: their errors, and the quality of their uncertainty.
//!
//! Positions are given in rad. Every result is in degrees, like the paper's figures.

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
