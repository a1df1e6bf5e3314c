//! The report of an evaluation, as its last task writes it.

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, Digest, Family, Normalization, Range};
use utoipa::ToSchema;

/// RMSE of every predictor in every cell and over the cells in and out of distribution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Report {
    /// Samples every predictor was given.
    pub context: u32,
    /// Samples it had to predict.
    pub horizon: u32,
    pub rate_hz: f64,
    #[serde(default)]
    pub bootstrap: Bootstrap,
    pub predictors: Vec<ReportedPredictor>,
    /// The frequencies the checkpoints were trained on.
    pub in_distribution: Vec<Band>,
    pub cells: Vec<ReportedCell>,
    pub groups: Vec<Group>,
    pub paired: Vec<PairedDifference>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportedPredictor {
    pub name: String,
    pub kind: PredictorKind,
    /// Of a checkpoint: the digest of its training's spec.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normalization: Option<Normalization>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PredictorKind {
    Baseline,
    Checkpoint,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Band {
    pub family: Family,
    pub frequency_hz: Range,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportedCell {
    pub family: Family,
    pub frequency_hz: f64,
    pub in_distribution: bool,
    pub scenarios: u64,
    pub rmse_deg: Vec<Rmse>,
}

/// Cells taken together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Group {
    pub name: String,
    pub scenarios: u64,
    pub rmse_deg: Vec<Rmse>,
}

/// Mean over scenarios with the ends of its 95 % interval, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Rmse {
    pub predictor: String,
    pub mean: f64,
    pub low: f64,
    pub high: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PairedDifference {
    pub group: String,
    pub predictor: String,
    pub against: String,
    /// RMSE of `predictor` less that of `against` on the same scenarios; negative is better.
    pub difference_deg: Interval,
}

/// A mean with the ends of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Interval {
    pub mean: f64,
    pub low: f64,
    pub high: f64,
}
