use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};

/// A metric of every validation. Lower is better.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum ValidationMetric {
    /// The root mean squared error over the horizon, averaged over joints and trajectories, in
    /// degrees.
    #[default]
    #[serde(rename = "validation/rmse_deg")]
    RmseDeg,
    /// The loss.
    #[serde(rename = "validation/loss")]
    Loss,
}

impl ValidationMetric {
    /// The metric's key in the records.
    pub const fn key(self) -> &'static str {
        match self {
            Self::RmseDeg => "validation/rmse_deg",
            Self::Loss => "validation/loss",
        }
    }
}

/// Ends a training when it no longer improves: after `patience` validations in a row that are not
/// lower than all before them by more than `min_delta`. It uses `monitor`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EarlyStopSpec {
    /// Number of validations in a row without an improvement after which the training ends.
    pub patience: u32,
    /// In the unit of `monitor`.
    pub min_delta: f64,
}

impl Default for EarlyStopSpec {
    fn default() -> Self {
        Self { patience: 10, min_delta: 0.0 }
    }
}

impl Check for EarlyStopSpec {
    fn check(&self, violations: &mut Violations) {
        violations.within("patience", self.patience, 1..=1_000_000);
        violations.within("min_delta", self.min_delta, 0.0..=1e9);
    }
}
