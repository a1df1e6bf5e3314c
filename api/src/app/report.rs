//! The report of an evaluation, as its last task writes it.

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, Digest, Family, JOINTS, Normalization, Range, SamplerKind, Start};
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
    /// Samples that each predictor with several was asked for.
    #[serde(default)]
    pub samples: u32,
    pub predictors: Vec<ReportedPredictor>,
    /// The frequencies the checkpoints were trained on.
    pub in_distribution: Vec<Band>,
    pub cells: Vec<ReportedCell>,
    pub groups: Vec<Group>,
    pub paired: Vec<PairedDifference>,
    /// Predictors without an answer to some scenarios of a cell, of which they have no mean.
    #[serde(default)]
    pub failures: Vec<ReportedFailure>,
    /// Of every predictor, the scenarios with the largest errors: with the seed and its index, a
    /// trajectory can be made again.
    #[serde(default)]
    pub worst: Vec<WorstCase>,
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
    /// Of a denoiser: how it was sampled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<ReportedSampling>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<Latency>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportedSampling {
    /// What predictors that differ in steps alone have in common.
    pub curve: String,
    pub kind: SamplerKind,
    /// Passes through the network.
    pub steps: u32,
    /// `oracle` holds what it is to predict.
    #[serde(default)]
    pub start: Start,
}

/// Times of one prediction of one robot, which depend on the machine and its load.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Latency {
    pub median_ms: f64,
    pub p99_ms: f64,
    #[serde(default)]
    pub repeats: u64,
    pub threads: u64,
    #[serde(default)]
    pub device: String,
    /// The machine's mean number of running threads in the minute before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReportedFailure {
    pub predictor: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// How many.
    pub scenarios: u64,
    /// Index of the first in the dataset.
    pub first: u64,
    pub reason: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WorstCase {
    pub predictor: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Index in the dataset.
    pub trajectory: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    pub rmse_deg: f64,
}

/// Means over scenarios and joints of what is measured besides the RMSE; what was not is missing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Scores {
    pub predictor: String,
    /// Of each joint.
    pub joint_rmse_deg: [f64; JOINTS],
    /// Of each step of the horizon.
    pub step_rmse_deg: Vec<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_deg: Option<Interval>,
    /// After a zero-phase low-pass, as the RMSE after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothed_jitter_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothed_rmse_deg: Option<Interval>,
    /// Of the mean of the samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_rmse_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crps_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy_score_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub intervals: Vec<CentralInterval>,
}

/// Central intervals of one probability.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CentralInterval {
    pub nominal: f64,
    /// Share of measured positions inside.
    pub coverage: Interval,
    pub width_deg: Interval,
}

impl ReportedPredictor {
    /// Whether something of what it is to predict was told to it.
    pub fn sees_the_future(&self) -> bool {
        self.normalization == Some(Normalization::PaperLeaky)
            || self.sampling.as_ref().is_some_and(|sampling| sampling.start == Start::Oracle)
    }
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
    /// Missing for data without a frequency grid, as the frequency.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    pub in_distribution: bool,
    pub scenarios: u64,
    pub rmse_deg: Vec<Rmse>,
    #[serde(default)]
    pub scores: Vec<Scores>,
}

/// Cells taken together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Group {
    pub name: String,
    pub scenarios: u64,
    pub rmse_deg: Vec<Rmse>,
    #[serde(default)]
    pub scores: Vec<Scores>,
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
