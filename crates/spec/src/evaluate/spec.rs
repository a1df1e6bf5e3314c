//! The spec of an evaluation: the data, the predictors, and how they are scored.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::predictions::FilePredictions;
use super::sampler::{EvaluationSampler, Start};
use crate::omitted::{is_one, is_zero};
use crate::{CheckpointRef, DataSource, Execution, Given};

/// Default number of windows before the scored one, in which a sampler continues its own
/// predictions.
const ROUNDS: u32 = 8;

/// Compares predictors on the same scenarios. There is one cell per excitation family and frequency
/// of the data's grid. Data without a grid is one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluateSpec {
    /// Default: a stream over the paper's frequencies and beyond, with chirps from 0.1 to 1 Hz,
    /// multisines from 0.01 to 0.5 Hz and the number of samples that is needed.
    #[schema(required = false)]
    pub data: DataSource,
    /// The series that predictors are given beside the positions of the context. Checkpoints are
    /// those that were trained with it.
    #[serde(default, skip_serializing_if = "Given::is_torques")]
    pub given: Given,
    /// Models that torqued trained.
    #[serde(default)]
    pub checkpoints: Vec<CheckpointRef>,
    /// Predictors that learn nothing from other robots. Default: all that answer with what is
    /// given, except `base-parameters`, `joint-ekf` and the `oracle`.
    #[serde(default = "Baseline::usual")]
    pub baselines: Vec<Baseline>,
    /// Models outside of torqued, as files of their predictions on a stored dataset. With them,
    /// `data` must not be a stream, and `position_noise_rad` must be left out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub predictions: Vec<FilePredictions>,
    /// Number of samples that every predictor is given.
    #[serde(default = "context")]
    pub context: u32,
    /// Number of samples to predict. Default: all samples of the data after `rounds` and `context`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub horizon: Option<u32>,
    /// Lengths of the first parts of the horizon over which errors are measured as well, s: up to
    /// 10. A length above the horizon becomes the horizon.
    #[serde(default = "horizons_s", skip_serializing_if = "are_usual_horizons")]
    pub horizons_s: Vec<f64>,
    /// Number of windows before the scored window. Consecutive windows are one sample apart.
    /// Predictions that start `shifted` begin this many control periods earlier. Default: 8 if there
    /// are such predictions, and 0 otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounds: Option<u32>,
    /// Number of scenarios of each cell: the first ones. Default: all, or 1000 for data without a
    /// grid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenarios: Option<u32>,
    /// Samplers of denoisers. Each denoiser is evaluated with each of them. Without any, each uses
    /// the sampler of its training.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub samplers: Vec<EvaluationSampler>,
    /// Number of predictions per scenario, 1 to 256, by models that can give several. From 2 on
    /// they are scored as a distribution.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub samples: u32,
    /// Standard deviations of Gaussian noise that is added to the positions of contexts, rad: 1 to
    /// 10 values from 0 to 0.1. Every predictor is evaluated at each value, and knows it. This
    /// noise is added to that of the data. Errors are measured against the true positions.
    #[serde(default = "noiseless", skip_serializing_if = "is_noiseless")]
    pub position_noise_rad: Vec<f64>,
    /// Seed of the noise of samples and of positions.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub seed: u64,
    /// Also measures how long one prediction takes. Unlike everything else in an evaluation, the
    /// result depends on the machine and its load.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<LatencySpec>,
    /// How the report's intervals over scenarios are resampled.
    #[serde(default)]
    pub bootstrap: Bootstrap,
    /// How the job is executed. It is not part of the digest.
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// Options of the latency measurement: predictions for a single robot, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LatencySpec {
    /// Number of timed predictions for each checkpoint and sampler, 20 to 10 000.
    pub repeats: u32,
}

impl Default for LatencySpec {
    fn default() -> Self {
        Self { repeats: 200 }
    }
}

/// A predictor that learns nothing from other robots.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Baseline {
    /// Holds the last position of the context.
    HoldLast,
    /// Goes on with the velocity at the end of the context.
    ConstantVelocity,
    /// Follows the reference of the controller, as far away from it as at the end of the context.
    /// Only with `given` references.
    FollowReference,
    /// q̇ = u / D with the nominal damping D, from the last context position.
    DampedIntegrator,
    /// q̇ = u / D, with D of each joint fitted to each robot's context.
    FittedDamping,
    /// v' = a·v + g·u + b per joint, with a, g and b fitted to each robot's context.
    LeastSquares,
    /// Like `least-squares`. It uses a higher order, and couples the torques of all joints, where
    /// that predicts the end of the context better.
    Arx,
    /// Simulates the nominal arm.
    NominalSimulator,
    /// Fits the parameters in which torques are linear to each robot's context, by a ridge
    /// regression towards the nominal arm's, and simulates that arm. Only where it is named.
    BaseParameters,
    /// Simulates the nominal arm with dampings fitted to each robot's context through the
    /// simulator.
    SimulatorFittedDamping,
    /// Filters positions, velocities and dynamic parameters of each robot along its context, by an
    /// extended Kalman filter, and simulates that arm. Only where it is named.
    JointEkf,
    /// Fits the dynamic parameters of each robot to its context through the simulator, starting
    /// from those of the nominal arm. An expert with a model would do this.
    Identification,
    /// The robot itself, from its last measured position: what can be known. Only of simulations, and
    /// only where it is named.
    Oracle,
}

impl Baseline {
    /// Those that answer with the references of a controller. The last one is told the controller.
    /// The others need torques.
    pub fn with_references() -> Vec<Self> {
        vec![
            Self::HoldLast,
            Self::ConstantVelocity,
            Self::FollowReference,
            Self::LeastSquares,
            Self::Arx,
            Self::NominalSimulator,
        ]
    }

    /// Those that answer with `given`, from the least to the most knowledge about the arms.
    pub fn answering(given: Given) -> Vec<Self> {
        match given {
            Given::Torques => Self::all(),
            Given::References => Self::with_references(),
        }
    }

    /// The default ones of those that answer with `given`.
    pub fn usual_with(given: Given) -> Vec<Self> {
        match given {
            Given::Torques => Self::usual(),
            Given::References => Self::with_references(),
        }
    }

    /// All baselines that answer with torques but the `oracle`, from the least to the most knowledge
    /// about the arms.
    pub fn all() -> Vec<Self> {
        vec![
            Self::HoldLast,
            Self::ConstantVelocity,
            Self::DampedIntegrator,
            Self::FittedDamping,
            Self::LeastSquares,
            Self::Arx,
            Self::NominalSimulator,
            Self::BaseParameters,
            Self::SimulatorFittedDamping,
            Self::JointEkf,
            Self::Identification,
        ]
    }

    /// The default ones with torques, in the same order. Results of earlier versions are found under
    /// the digest of these.
    pub fn usual() -> Vec<Self> {
        Self::all().into_iter().filter(|baseline| !baseline.must_be_named()).collect()
    }

    /// Whether an evaluation has it only if it names it.
    const fn must_be_named(self) -> bool {
        matches!(self, Self::BaseParameters | Self::JointEkf | Self::Oracle)
    }

    /// Removes `constant-velocity` from a job's JSON if `baselines` names the usual ones.
    ///
    /// It was added after the others. An evaluation of them keeps its digest, so that the
    /// results of earlier versions are still found under it. These results lack its row, and
    /// everything else in them is the same.
    pub(crate) fn leave_out_of_digest(fields: &mut Map<String, Value>) {
        let Some(baselines) = fields.get_mut("baselines") else { return };
        if serde_json::to_value(Self::usual()).is_ok_and(|all| all == *baselines)
            && let Value::Array(names) = baselines
        {
            names.retain(|name| name != "constant-velocity");
        }
    }

    /// Whether a baseline has this name in specs and in tables.
    pub fn is_name(name: &str) -> bool {
        let is_named = |baseline| serde_json::to_value(baseline).is_ok_and(|known| known == name);
        let others = Self::with_references().into_iter().chain([Self::Oracle]);
        Self::all().into_iter().chain(others).any(is_named)
    }

    /// Its knowledge about the arms before it sees a context. Reports call it `told`.
    pub const fn prior_knowledge(self, given: Given) -> &'static str {
        match (self, given) {
            (Self::NominalSimulator, Given::References) => return "the nominal arm, the controller",
            (Self::Oracle, Given::References) => return "the robot, the controller",
            _ => {}
        }
        match self {
            Self::HoldLast
            | Self::ConstantVelocity
            | Self::FollowReference
            | Self::FittedDamping
            | Self::LeastSquares
            | Self::Arx => "nothing",
            Self::DampedIntegrator => "the nominal damping",
            Self::NominalSimulator | Self::BaseParameters => "the nominal arm",
            Self::SimulatorFittedDamping => "the nominal arm, how dampings vary",
            Self::JointEkf | Self::Identification => "the nominal arm, how all of it varies",
            Self::Oracle => "the robot, its velocity at the end of the context",
        }
    }
}

/// Percentile bootstrap over scenarios, for the 95 % confidence intervals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bootstrap {
    /// Number of resamples.
    pub resamples: u32,
    /// Seed of the resamples.
    pub seed: u64,
}

impl Default for Bootstrap {
    fn default() -> Self {
        Self { resamples: 2000, seed: 0 }
    }
}

const fn context() -> u32 {
    320
}

/// A step of a controller, half a second, and the paper's horizon.
fn horizons_s() -> Vec<f64> {
    vec![0.1, 0.5, 1.33]
}

fn are_usual_horizons(seconds: &[f64]) -> bool {
    seconds == horizons_s()
}

fn noiseless() -> Vec<f64> {
    vec![0.0]
}

fn is_noiseless(levels: &[f64]) -> bool {
    levels == [0.0]
}

const fn one() -> u32 {
    1
}

impl EvaluateSpec {
    /// Number of windows before the scored one.
    pub fn rounds(&self) -> u32 {
        self.rounds.unwrap_or(if self.starts_shifted() { ROUNDS } else { 0 })
    }

    /// Number of samples to predict in trajectories with `samples`; 0 if they are too short.
    pub fn horizon(&self, samples: u32) -> u32 {
        let rest = samples.saturating_sub(self.context).saturating_sub(self.rounds());
        self.horizon.unwrap_or(rest)
    }

    pub(super) fn starts_shifted(&self) -> bool {
        self.samplers.iter().any(|sampler| sampler.start == Start::Shifted)
    }
}
