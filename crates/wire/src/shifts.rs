//! Errors by how the torques of a cell differ from those of the trainings.

use serde::{Deserialize, Serialize};
use spec::Family;
use utoipa::ToSchema;

use crate::Interval;
use crate::report::is_zero;

/// How the torques of a cell differ from those that checkpoints were trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Shift {
    /// They do not differ: family, frequency and amplitude occur in the trainings.
    Within,
    /// The frequency is lower than in any training.
    Below,
    /// The frequency is higher than in any training.
    Above,
    /// The frequency occurs in the trainings, but the torques are larger.
    Amplitude,
    /// The family does not occur in the trainings.
    Family,
}

impl Shift {
    /// All shifts, in the order of tables.
    pub const ALL: [Self; 5] =
        [Self::Within, Self::Below, Self::Above, Self::Amplitude, Self::Family];
}

impl std::fmt::Display for Shift {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Within => "within the training",
            Self::Below => "below the band",
            Self::Above => "above the band",
            Self::Amplitude => "larger torques",
            Self::Family => "another family",
        })
    }
}

/// All cells with one shift, or only those of one family.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShiftSummary {
    /// How the torques of its cells differ from the trainings' torques.
    pub shift: Shift,
    /// Missing for all families together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// Standard deviation of the noise added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// Number of scenarios.
    pub scenarios: u64,
    /// Number of scored scenarios: those whose torques stay within every joint's rated torque.
    pub scored: u64,
    /// In the order of every table. Empty if nothing is scored.
    pub models: Vec<ShiftScores>,
    /// Differences between the first predictor of each entry of `models` and that of an earlier
    /// entry. Each predictor stands for its replications.
    pub differences: Vec<ShiftDifference>,
}

/// Errors of a predictor, or of several that differ only in the seeds of their trainings.
///
/// Intervals cover robots and seeds. Their half-widths are the root of the sum of two squares: of
/// robots by the bootstrap, and of seeds by Student's t. With a single seed they cover only robots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShiftScores {
    /// The names of the predictors that the entry combines.
    pub predictors: Vec<String>,
    /// Missing if some scenario has no answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rmse_deg: Option<Interval>,
    /// The RMSE of each training that this entry combines, degrees.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seed_rmse_deg: Vec<f64>,
    /// 1 - RMSE / RMSE of `damped-integrator`. Missing if that baseline was not evaluated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skill: Option<Interval>,
    /// The largest RMSE of a scenario, over all seeds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_deg: Option<f64>,
    /// Mean over scenarios and seeds.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_rmse_deg: Vec<f64>,
    /// RMSE of the mean of several samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_rmse_deg: Option<Interval>,
    /// Share of predictions that are not finite, or more than 180° from the measured position.
    pub diverged: f64,
}

/// The difference between two entries on the same scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShiftDifference {
    /// The name of one predictor.
    pub predictor: String,
    /// The name of the other.
    pub against: String,
    /// RMSE of `predictor` minus that of `against`. Negative is better.
    pub difference_deg: Interval,
}
