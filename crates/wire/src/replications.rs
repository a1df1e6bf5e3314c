//! Errors of trainings that differ only in their seeds, as one entry.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Interval;

/// Errors of a predictor, or of several that differ only in the seeds of their trainings. Intervals
/// cover robots and seeds, as those of [`crate::ShiftScores`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReplicationSummary {
    /// The names of the predictors that the entry combines.
    pub predictors: Vec<String>,
    /// Errors over the first parts of the horizon, in the order of the spec's `horizons_s`, without
    /// those for which some scenario has no answer.
    pub errors: Vec<ReplicatedError>,
    /// Share of predictions that are not finite, or more than 180° from the measured position, over
    /// all seeds.
    pub diverged: f64,
}

/// The error of one or several trainings over the first part of the horizon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReplicatedError {
    /// The length of that part, s.
    pub seconds: f64,
    /// RMSE over it: mean over joints, scenarios and seeds, degrees.
    pub rmse_deg: Interval,
    /// The RMSE of each training, degrees.
    pub seed_rmse_deg: Vec<f64>,
}

/// The difference between two entries of `replications` on the same scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReplicationDifference {
    /// The name of the first predictor of one entry.
    pub predictor: String,
    /// The name of the first predictor of the other.
    pub against: String,
    /// The length of the part of the horizon, s.
    pub seconds: f64,
    /// RMSE of `predictor` minus that of `against`, degrees. Negative is better.
    pub difference_deg: Interval,
}
