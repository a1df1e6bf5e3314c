use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Report};

/// A number that every validation gives and that is better the lower it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub enum ValidationMetric {
    /// √(mean over the horizon of the squared error) of each joint and trajectory, averaged.
    #[default]
    #[serde(rename = "validation/rmse_deg")]
    RmseDeg,
    /// What training makes small.
    #[serde(rename = "validation/loss")]
    Loss,
}

impl ValidationMetric {
    /// As it is recorded.
    pub const fn key(self) -> &'static str {
        match self {
            Self::RmseDeg => "validation/rmse_deg",
            Self::Loss => "validation/loss",
        }
    }
}

/// When a training has learned what it will learn: after `patience` validations in a row none of
/// which was lower, by more than `min_delta`, than all before them. Looks at `monitor`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EarlyStopSpec {
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
    fn check(&self, report: &mut Report) {
        report.within("patience", self.patience, 1..=1_000_000);
        report.within("min_delta", self.min_delta, 0.0..=1e9);
    }
}
