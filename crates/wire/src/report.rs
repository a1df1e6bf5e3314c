//! The report of an evaluation. Every number has its interval, and numbers in and out of
//! distribution are separate.
//!
//! The last task of an evaluation writes it as `report.json`. Errors are in degrees.

use serde::{Deserialize, Serialize};
use spec::{Bootstrap, Digest, Family, Given, Normalization, Range, SamplerKind, Start};
use utoipa::ToSchema;

use crate::measures::measures;
use crate::{ReplicationDifference, ReplicationSummary, Shift, ShiftSummary, Warning};

/// The RMSE of every predictor in every cell, and over the cells in and out of distribution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Report {
    /// Number of samples that every predictor was given.
    pub context: u32,
    /// Number of samples that it had to predict.
    pub horizon: u32,
    /// Samples per second.
    pub rate_hz: f64,
    /// How the intervals are resampled.
    pub bootstrap: Bootstrap,
    /// Number of samples drawn from each predictor that can give several.
    pub samples: u32,
    /// The signals that every predictor was given over context and horizon; missing for torques.
    #[serde(default, skip_serializing_if = "Given::is_torques")]
    pub given: Given,
    /// The noise of the data itself; missing for data without noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data_noise: Option<DataNoise>,
    /// The predictors, in the order of every table.
    pub predictors: Vec<PredictorInfo>,
    /// The frequencies on which all checkpoints were trained. Cells with these are in distribution.
    pub in_distribution: Vec<TrainedOn>,
    /// The cells, in the order of the evaluation.
    pub cells: Vec<CellSummary>,
    /// Means over cells: in distribution, out of distribution, and those without a frequency.
    pub groups: Vec<GroupSummary>,
    /// Differences of predictors on the same scenarios, for each group.
    pub paired: Vec<PairedDifference>,
    /// Predictors without an answer to some scenarios of a cell. They have no mean over that cell
    /// or over a group with it.
    #[serde(default)]
    pub failures: Vec<FailureSummary>,
    /// The scenarios with the largest errors of each predictor, largest first. With the seed and
    /// its index, a trajectory can be made again.
    #[serde(default)]
    pub worst: Vec<WorstCase>,
    /// Cells grouped by how their torques differ from the trainings' torques. Only scenarios whose
    /// torques the robot's motors can produce count. Trainings that differ only in seeds are
    /// combined. Missing without checkpoints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub shifts: Vec<ShiftSummary>,
    /// Torques, positions and rates of the evaluation's data that lie outside a checkpoint's
    /// training data, and contexts from which nothing can be identified. A checkpoint that does not
    /// record its training data has no warnings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

impl Report {
    /// The number of all scenarios of the evaluation.
    pub fn scenarios(&self) -> u64 {
        self.cells.iter().map(|cell| cell.scenarios).sum()
    }

    /// The RMSE of `predictor` minus that of `against` on the scenarios of `group`, degrees. `None`
    /// where the report has no such pair.
    pub fn difference(
        &self,
        group: &GroupSummary,
        predictor: &str,
        against: &str,
    ) -> Option<Interval> {
        let is_sought = |pair: &&PairedDifference| {
            (pair.predictor.as_str(), pair.against.as_str()) == (predictor, against)
                && pair.group == group.name
                && pair.position_noise_rad == group.position_noise_rad
        };
        self.paired.iter().find(is_sought).map(|pair| pair.difference_deg)
    }
}

/// The name of the baseline that is the robot itself.
pub const ORACLE: &str = "oracle";

/// The name of a predictor, its kind and its training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictorInfo {
    /// The name in tables and figures.
    pub name: String,
    /// Whether a baseline, a checkpoint or a file of predictions answers.
    pub kind: PredictorKind,
    /// Its knowledge about the arms before it sees a context.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub told: Option<String>,
    /// The digest of the spec that a checkpoint was trained by, or that predictions were imported by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<Digest>,
    /// SHA-256 of the file that predictions were sent as.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<Digest>,
    /// The digest of that spec with the seeds of the training and of its simulated data set to 0.
    /// Trainings that share it are replications. Missing for recordings and for checkpoints that
    /// are not final.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replicates: Option<Digest>,
    /// The normalization of a checkpoint's training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normalization: Option<Normalization>,
    /// The sampling of a denoiser.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<SamplingInfo>,
    /// The latency of its predictions. Missing if it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<Latency>,
}

impl PredictorInfo {
    /// Whether it is the robot itself, which shows what can be known and is no competitor.
    pub fn is_oracle(&self) -> bool {
        self.kind == PredictorKind::Baseline && self.name == ORACLE
    }

    /// Whether it may be called the best.
    pub fn competes(&self) -> bool {
        !self.sees_the_future() && !self.is_oracle()
    }

    /// `true` if it was given something of the horizon that it predicts.
    pub fn sees_the_future(&self) -> bool {
        self.normalization == Some(Normalization::PaperLeaky)
            || self.sampling.as_ref().is_some_and(|sampling| sampling.start == Start::Oracle)
    }
}

/// Where the answers of a predictor come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PredictorKind {
    /// It learns nothing from other robots.
    Baseline,
    /// A model that torqued trained.
    Checkpoint,
    /// A model that torqued does not know, by a file of its predictions. Nobody can tell whether it
    /// saw the positions that it predicts.
    Predictions,
}

/// The sampling of a denoiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SamplingInfo {
    /// The name of the curve in figures over steps. Predictors that differ only in `steps` share
    /// it.
    pub curve: String,
    /// How noise is removed.
    pub kind: SamplerKind,
    /// Number of passes through the network.
    pub steps: u32,
    /// The starting point of the sampler; `oracle` starts with the truth.
    #[serde(default)]
    pub start: Start,
}

measures! {
    /// Latencies of predictions for one robot. They depend on the machine and its load. So unlike the
    /// rest of a report, they differ when the evaluation is repeated.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
    pub struct Latency {
        /// Median of the timed predictions, ms.
        pub median_ms: f64 = Latency "median" Milliseconds,
        /// 99th percentile of the timed predictions, ms.
        pub p99_ms: f64 = Latency "99th percentile" Milliseconds,
        /// Number of timed predictions.
        pub repeats: u64,
        /// Number of threads that computed.
        pub threads: u64,
        /// The device that computed.
        pub device: String,
        /// The machine's mean number of running threads in the minute before.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub load: Option<f64>,
    }
}

/// The master frequencies of one family that trainings drew from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrainedOn {
    /// The excitation family.
    pub family: Family,
    /// The drawn frequencies, Hz.
    pub frequency_hz: Range,
    /// The range of amplitudes, N·m; for multisines N·m per Hz. Missing in older reports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplitude: Option<Range>,
}

/// One excitation at one frequency, or all data if there is no frequency grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CellSummary {
    /// Like the frequency, it is missing for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// The frequency of the excitation, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// Whether all checkpoints were trained on its family, frequency and amplitudes.
    pub in_distribution: bool,
    /// Missing without checkpoints, and for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift: Option<Shift>,
    /// Number of scenarios.
    pub scenarios: u64,
    /// Share of scenarios whose torques stay within every joint's rated torque.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_torque_limits: Option<f64>,
    /// The RMSE of each predictor that answered all scenarios, degrees.
    pub rmse_deg: Vec<PredictorSummary>,
    /// Further scores of each of these predictors.
    #[serde(default)]
    pub scores: Vec<PredictorScores>,
    /// How far the predictions of each predictor went.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rollouts: Vec<RolloutSummary>,
    /// Root mean square of the measured motions above the frequency where jitter begins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_jitter_deg: Option<f64>,
    /// Share of scenarios whose measured motions exceed a joint limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_left_limits: Option<f64>,
}

/// All cells in distribution, all cells out of distribution, or all cells without a frequency.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct GroupSummary {
    /// `in distribution`, `out of distribution` or `all scenarios`, with the level of noise if
    /// there is one.
    pub name: String,
    /// Number of scenarios.
    pub scenarios: u64,
    /// Standard deviation of the noise added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// The RMSE of each predictor that answered all scenarios, degrees.
    pub rmse_deg: Vec<PredictorSummary>,
    /// Further scores of each of these predictors.
    #[serde(default)]
    pub scores: Vec<PredictorScores>,
    /// How far the predictions of each predictor went.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rollouts: Vec<RolloutSummary>,
    /// The errors of each predictor over parts of the horizon, with trainings that differ only in
    /// seeds as one entry. Empty if no two trainings do.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replications: Vec<ReplicationSummary>,
    /// Differences between two entries of `replications` on the same scenarios, over each part of
    /// the horizon.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replication_differences: Vec<ReplicationDifference>,
}

measures! {
    /// How far the predictions of one predictor went. Predictions that are not finite count in both
    /// numbers.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
    pub struct RolloutSummary {
        /// The name of the predictor.
        pub predictor: String,
        /// Share of scenarios in which the prediction exceeds a joint limit. Missing if the limits are
        /// not known.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub left_limits: Option<f64> = Continuity "left limits" Share,
        /// Share of scenarios in which the prediction is not finite, or is more than 180° away from the
        /// measured position.
        pub diverged: f64 = Continuity "diverged" Share,
    }
}

/// Mean RMSE over scenarios with its interval, in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PredictorSummary {
    /// The name of the predictor.
    pub predictor: String,
    /// The mean and its interval, degrees.
    #[serde(flatten)]
    pub interval: Interval,
}

measures! {
    /// Further scores of one predictor: means over scenarios and joints. Scores that were not measured
    /// are missing.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
    pub struct PredictorScores {
        /// The name of the predictor.
        pub predictor: String,
        /// Mean over scenarios, a value per joint.
        pub joint_rmse_deg: Vec<f64>,
        /// Root mean square over scenarios and joints, a value per step of the horizon.
        pub step_rmse_deg: Vec<f64>,
        /// Errors over the first parts of the horizon, in the order of the spec's `horizons_s`.
        /// Missing in older reports.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        pub horizon_errors: Vec<HorizonError>,
        /// Error of the first sample of the horizon: root mean square over scenarios and joints.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub first_sample_deg: Option<Interval> = Continuity "first sample" Degrees,
        /// Change of the error from one sample of the horizon to the next, without seams: root mean
        /// square over scenarios, joints and samples.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub jump_deg: Option<Interval> = Continuity "jump" Degrees,
        /// The same change at the seams of a model that predicts several samples at a time.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub seam_jump_deg: Option<Interval> = Continuity "at seams" Degrees,
        /// The largest change of the error from one sample to the next, averaged over scenarios and
        /// joints.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub largest_jump_deg: Option<Interval> = Continuity "mean largest" Degrees,
        /// Root mean square of the predictions' jitter, which is their part above the signal's band.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub jitter_deg: Option<Interval> = Jitter "jitter" Degrees,
        /// The jitter after a zero-phase low-pass, which is also used for the smoothed RMSE.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub smoothed_jitter_deg: Option<Interval> = Jitter "after a low-pass" Degrees,
        /// RMSE after that low-pass.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub smoothed_rmse_deg: Option<Interval> = Jitter "RMSE after the low-pass" Degrees,
        /// RMSE of the torque that the predictor's arm takes for the measured motion of the horizon,
        /// against the torque that acted. Missing for predictors without a model of the arm.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub torque_rmse_nm: Option<Interval> = Torque "RMSE" NewtonMetres,
        /// RMSE of the mean of the samples.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub mean_rmse_deg: Option<Interval> = Samples "RMSE of the mean" Degrees,
        /// Continuous ranked probability score: a fair estimate from the samples.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub crps_deg: Option<Interval> = Samples "CRPS" Degrees,
        /// Energy score: a fair estimate from the samples.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub energy_score_deg: Option<Interval> = Samples "energy score" Degrees,
        /// Central intervals of the samples at 50 % and 90 %.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        pub intervals: Vec<IntervalSummary>,
        /// Coverage of central intervals from 10 % to 90 %.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        pub calibration: Vec<Calibration>,
    }
}

/// The error over the first part of the horizon.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HorizonError {
    /// The length of that part, s.
    pub seconds: f64,
    /// RMSE over it: mean over joints and scenarios, degrees.
    pub rmse_deg: Interval,
}

/// Central intervals of one probability.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct IntervalSummary {
    /// The probability of the intervals.
    pub nominal: f64,
    /// Share of measured positions inside the intervals.
    pub coverage: Interval,
    /// Their mean width, degrees.
    pub width_deg: Interval,
    /// That share for each joint. Missing in older reports.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_coverage: Vec<f64>,
    /// That share at each step of the horizon. Missing in older reports.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub step_coverage: Vec<f64>,
}

/// The share of measured positions inside central intervals of one probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Calibration {
    /// The probability of the intervals.
    pub nominal: f64,
    /// The share of measured positions inside them.
    pub coverage: f64,
}

/// The difference between two predictors on the same scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PairedDifference {
    /// The name of the group.
    pub group: String,
    /// The name of one predictor.
    pub predictor: String,
    /// Standard deviation of the noise added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// The name of the other.
    pub against: String,
    /// RMSE of `predictor` minus that of `against`. Negative is better.
    pub difference_deg: Interval,
}

/// A predictor without an answer to some scenarios of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FailureSummary {
    /// The name of the predictor.
    pub predictor: String,
    /// The family of the cell. Missing for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// The frequency of the cell, Hz. Missing for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// The number of those scenarios.
    pub scenarios: u64,
    /// Index of the first of them in the dataset.
    pub first: u64,
    /// Why the first of them has no answer.
    pub reason: String,
}

/// A scenario with a large error. With the spec of its dataset and its index it can be made again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WorstCase {
    /// The name of the predictor.
    pub predictor: String,
    /// The family of the cell. Missing for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<Family>,
    /// The frequency of the cell, Hz. Missing for data without a frequency grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// Standard deviation of the noise added to the positions of contexts, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub position_noise_rad: f64,
    /// Index in the dataset.
    pub trajectory: u64,
    /// The seed of the dataset's simulation. Recordings have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// The RMSE over horizon and joints, degrees.
    pub rmse_deg: f64,
}

/// A mean with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Interval {
    /// The mean.
    pub mean: f64,
    /// The lower end of the interval.
    pub low: f64,
    /// The upper end of the interval.
    pub high: f64,
}

/// Standard deviations of the errors of measured values, without the noise that an evaluation adds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DataNoise {
    /// The standard deviation of measured positions, rad.
    pub position_rad: f64,
    /// The standard deviation of measured torques, N·m.
    pub torque_nm: f64,
}

/// The suffix that tables use for a level of noise, after the name of a cell or a group. Empty at
/// 0.
pub fn at_noise(position_noise_rad: f64) -> String {
    if position_noise_rad > 0.0 { format!(" at {position_noise_rad} rad") } else { String::new() }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
pub(crate) fn is_zero(value: &f64) -> bool {
    *value == 0.0
}
