//! The report of an evaluation: every number with its interval, in and out of distribution apart.
//!
//! The last task of an evaluation writes it as `report.json`. Errors are in degrees.

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, Digest, Family, Normalization, Range, SamplerKind, Start};
use utoipa::ToSchema;

use crate::Warning;

/// RMSE of every predictor in every cell and over the cells in and out of distribution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Report {
    /// Samples every predictor was given.
    pub context: u32,
    /// Samples it had to predict.
    pub horizon: u32,
    pub rate_hz: f64,
    pub bootstrap: Bootstrap,
    /// Samples that each predictor with several was asked for.
    pub samples: u32,
    /// The noise of the data itself; none of data without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data_noise: Option<DataNoise>,
    /// The predictors, in the order of every table.
    pub predictors: Vec<PredictorInfo>,
    /// The frequencies that all checkpoints were trained on; cells inside are in distribution.
    pub in_distribution: Vec<TrainedOn>,
    pub cells: Vec<CellSummary>,
    pub groups: Vec<GroupSummary>,
    pub paired: Vec<PairedDifference>,
    /// Predictors without an answer to some scenarios of a cell. They have no mean over that cell,
    /// nor over a group with it.
    #[serde(default)]
    pub failures: Vec<FailureSummary>,
    /// The scenarios on which each predictor has its largest errors, the largest first: with the
    /// seed and its index, a trajectory can be made again.
    #[serde(default)]
    pub worst: Vec<WorstCase>,
    /// Cells by how their torques differ from those of the trainings, over the scenarios whose torques the
    /// robot's motors can give, with trainings that differ in seeds alone taken together. None without checkpoints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shifts: Vec<ShiftSummary>,
    /// Torques, positions and rates that a checkpoint was not trained on, of the data that it was asked
    /// about, and contexts that nothing can be identified from. None of checkpoints that do not say what they
    /// were trained on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

impl Report {
    /// All scenarios that were asked about.
    pub fn scenarios(&self) -> u64 {
        self.cells.iter().map(|cell| cell.scenarios).sum()
    }
}

/// The name of a predictor, its kind and its training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictorInfo {
    pub name: String,
    pub kind: PredictorKind,
    /// What it knows of the arms before it sees a context.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub told: Option<String>,
    /// The digest of the spec that a checkpoint was trained by, or that predictions were imported by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
    /// SHA-256 of the file that predictions were sent as.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<Digest>,
    /// The digest of that spec with the seeds of the training and of its simulated data set to 0: trainings that
    /// share it are replications. Missing of recordings and of checkpoints that are not final.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replicates: Option<Digest>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normalization: Option<Normalization>,
    /// The sampling of a denoiser.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<SamplingInfo>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<Latency>,
}

impl PredictorInfo {
    /// `true` if it was told something of the horizon that it predicts.
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
    /// A model that torqued does not know, by a file of its predictions. Nobody can tell whether it saw the
    /// positions that it predicts.
    Predictions,
}

/// The sampling of a denoiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SamplingInfo {
    /// The name of the curve in figures over steps: predictors that differ in `steps` alone share it.
    pub curve: String,
    pub kind: SamplerKind,
    /// Passes through the network.
    pub steps: u32,
    /// `oracle` starts with the truth.
    #[serde(default)]
    pub start: Start,
}

/// Times of one prediction of one robot. They depend on the machine and its load: unlike the rest of
/// a report, they differ when it is made again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Latency {
    pub median_ms: f64,
    pub p99_ms: f64,
    /// Predictions that were timed.
    pub repeats: u64,
    /// Threads that computed.
    pub threads: u64,
    pub device: String,
    /// The machine's mean number of running threads in the minute before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<f64>,
}

/// Master frequencies of one family that trainings drew from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrainedOn {
    pub family: Family,
    pub frequency_hz: Range,
    /// Interval of amplitudes, N·m, of multisines N·m per Hz; missing in older reports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplitude: Option<Range>,
}

/// How the torques of a cell differ from those that checkpoints were trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Shift {
    /// Not at all: a family, frequency and amplitude of the trainings.
    Within,
    /// The frequency is lower than any of the trainings.
    Below,
    /// The frequency is higher.
    Above,
    /// A frequency of the trainings with larger torques.
    Amplitude,
    /// Another kind of torques.
    Family,
}

impl Shift {
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

/// All cells with one shift, or those of one family among them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShiftSummary {
    pub shift: Shift,
    /// Missing of all families together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// Standard deviation of the noise that was added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    pub scenarios: u64,
    /// The scenarios, among these, whose torques stay within the rated ones of every joint: those that are scored here.
    pub scored: u64,
    /// In the order of every table; none where nothing is scored.
    pub models: Vec<ShiftScores>,
    /// The first predictor of each entry of `models` against that of an entry before it; each stands for its
    /// replications.
    pub differences: Vec<ShiftDifference>,
}

/// Errors of a predictor, or of several that differ in nothing but the seeds of their trainings.
///
/// Intervals are over robots and seeds: half-widths of both, added as squares; of robots by the bootstrap, of seeds
/// by Student's t. With a single seed they are over robots alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShiftScores {
    pub predictors: Vec<String>,
    /// Missing where some scenario has no answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rmse_deg: Option<Interval>,
    /// The RMSE of each training that this entry takes together, degrees.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seed_rmse_deg: Vec<f64>,
    /// 1 - RMSE / RMSE of `damped-integrator`; missing where that was not asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skill: Option<Interval>,
    /// The largest RMSE of a scenario, of all seeds.
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
    pub predictor: String,
    pub against: String,
    /// RMSE of `predictor` less that of `against`; negative is better.
    pub difference_deg: Interval,
}

/// One excitation at one frequency, or all of data without a frequency grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellSummary {
    /// Missing for data without a frequency grid, like the frequency.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise that was added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    pub in_distribution: bool,
    /// Missing without checkpoints and of data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift: Option<Shift>,
    pub scenarios: u64,
    /// Share of the scenarios whose torques stay within the rated ones of every joint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_torque_limits: Option<f64>,
    pub rmse_deg: Vec<PredictorSummary>,
    #[serde(default)]
    pub scores: Vec<PredictorScores>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rollouts: Vec<RolloutSummary>,
    /// Root mean square of the measured motions above the band that jitter is measured from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_jitter_deg: Option<f64>,
    /// Share of the scenarios whose measured motions leave the joints' limits themselves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_left_limits: Option<f64>,
}

/// All cells in distribution, all out of it, or all that have no frequency.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct GroupSummary {
    pub name: String,
    pub scenarios: u64,
    /// Standard deviation of the noise that was added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    pub rmse_deg: Vec<PredictorSummary>,
    #[serde(default)]
    pub scores: Vec<PredictorScores>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rollouts: Vec<RolloutSummary>,
}

/// Where the predictions of one predictor went. Predictions that are not finite count in both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RolloutSummary {
    pub predictor: String,
    /// Share of the scenarios in which the prediction leaves the limits of some joint; missing where the
    /// limits are not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_limits: Option<f64>,
    /// Share of the scenarios in which the prediction is not finite, or more than 180° from the measured
    /// position.
    pub diverged: f64,
}

/// Mean RMSE over scenarios with its interval, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictorSummary {
    pub predictor: String,
    #[serde(flatten)]
    pub interval: Interval,
}

/// Everything else that was measured of one predictor: means over scenarios and joints. Quantities
/// that were not measured are missing.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictorScores {
    pub predictor: String,
    /// Mean over scenarios, a value per joint.
    pub joint_rmse_deg: Vec<f64>,
    /// Root mean square over scenarios and joints, a value per step of the horizon.
    pub step_rmse_deg: Vec<f64>,
    /// Error of the first sample of the horizon: root mean square over scenarios and joints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_sample_deg: Option<Interval>,
    /// Change of the error from one sample of the horizon to the next, seams left out: root mean square over
    /// scenarios, joints and samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jump_deg: Option<Interval>,
    /// The same at the seams of a model that predicts several samples at a time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seam_jump_deg: Option<Interval>,
    /// The largest change of the error from one sample to the next, mean over scenarios and joints.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_jump_deg: Option<Interval>,
    /// Root mean square of what a prediction has above the signal's band.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_deg: Option<Interval>,
    /// The same after a zero-phase low-pass, like the RMSE after it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothed_jitter_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothed_rmse_deg: Option<Interval>,
    /// RMSE of the mean of the samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean_rmse_deg: Option<Interval>,
    /// Fair estimate from the samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crps_deg: Option<Interval>,
    /// Fair estimate from the samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy_score_deg: Option<Interval>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub intervals: Vec<IntervalSummary>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibration: Vec<Calibration>,
}

/// Central intervals of one probability.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct IntervalSummary {
    pub nominal: f64,
    /// Share of measured positions inside.
    pub coverage: Interval,
    pub width_deg: Interval,
}

/// The share of measured positions inside central intervals of one probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Calibration {
    pub nominal: f64,
    pub coverage: f64,
}

/// The difference between two predictors on the same scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PairedDifference {
    pub group: String,
    pub predictor: String,
    /// Standard deviation of the noise that was added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    pub against: String,
    /// RMSE of `predictor` less that of `against`; negative is better.
    pub difference_deg: Interval,
}

/// A predictor without an answer to some scenarios of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FailureSummary {
    pub predictor: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise that was added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// The number of those scenarios.
    pub scenarios: u64,
    /// Index of the first in the dataset.
    pub first: u64,
    pub reason: String,
}

/// A scenario to look at: with the spec of its dataset, its index makes it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WorstCase {
    pub predictor: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise that was added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// Index in the dataset.
    pub trajectory: u64,
    /// The seed of the dataset's simulation; recordings have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    pub rmse_deg: f64,
}

/// A mean with the ends of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Interval {
    pub mean: f64,
    pub low: f64,
    pub high: f64,
}

/// Standard deviations of the errors of measured values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DataNoise {
    pub position_rad: f64,
    pub torque_nm: f64,
}

/// How tables name a level of noise, after what they name a cell or a group: nothing at 0.
pub fn at_noise(position_noise_rad: f64) -> String {
    if position_noise_rad > 0.0 { format!(" at {position_noise_rad} rad") } else { String::new() }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}
