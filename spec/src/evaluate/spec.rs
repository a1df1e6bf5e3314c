use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::predictions::FilePredictions;
use super::sampler::{EvaluationSampler, Start};
use crate::{CheckpointRef, DataSource, Execution};

/// Windows before the scored one, where a sampler goes on from its own predictions.
const ROUNDS: u32 = 8;

/// Compare predictors on the same scenarios: in cells, one per excitation family and frequency of the
/// data's grid. Data without a grid is one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluateSpec {
    /// Left out, a stream over the paper's frequencies and those beyond: chirps from 0.1 to 1 Hz and
    /// multisines from 0.01 to 0.5 Hz, with as many samples as are needed.
    #[schema(required = false)]
    pub data: DataSource,
    #[serde(default)]
    pub checkpoints: Vec<CheckpointRef>,
    #[serde(default = "Baseline::all")]
    pub baselines: Vec<Baseline>,
    /// Models that torqued does not know, by files of their predictions. Such a file answers a stored dataset without
    /// further noise: `data` is no stream, and `position_noise_rad` is left out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub predictions: Vec<FilePredictions>,
    /// Samples every predictor is given.
    #[serde(default = "context")]
    pub context: u32,
    /// Samples it has to predict; left out, what the data has after `rounds` and `context`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub horizon: Option<u32>,
    /// Samples, and so windows, before the scored window: predictions that start `shifted` begin so
    /// many control periods earlier. Left out, 8 when there are such, else 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounds: Option<u32>,
    /// Scenarios of each cell, its first; left out, all of them, and of data without a grid the first
    /// 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenarios: Option<u32>,
    /// How denoisers are sampled: each with each. Without any, each as its training says.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub samplers: Vec<EvaluationSampler>,
    /// Predictions of each scenario, 1 to 256, by the models that have several; from 2 on they are
    /// scored as a distribution.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub samples: u32,
    /// Standard deviations of Gaussian noise that is added to the positions of contexts, rad: 1 to 10 of
    /// them, 0 to 0.1. Every predictor is asked at each, and knows which. The noise of the data itself
    /// comes on top. Errors are those against the true positions.
    #[serde(default = "noiseless", skip_serializing_if = "is_noiseless")]
    pub position_noise_rad: Vec<f64>,
    /// Key of the samples' noise and of that of positions.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub seed: u64,
    /// Also measure how long one prediction takes. What comes out depends on the machine and its load,
    /// unlike all else of an evaluation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<LatencySpec>,
    #[serde(default)]
    pub bootstrap: Bootstrap,
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
}

/// How latencies are measured: one prediction after the other, of a single robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LatencySpec {
    /// Predictions timed for each checkpoint and sampler, 20 to 10 000.
    pub repeats: u32,
}

impl Default for LatencySpec {
    fn default() -> Self {
        Self { repeats: 200 }
    }
}

/// A predictor that learns nothing from other robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Baseline {
    /// The last context position, held.
    HoldLast,
    /// q̇ = u / D with the nominal damping D, from the last context position.
    DampedIntegrator,
    /// q̇ = u / D with D of each joint of each robot fitted to its context.
    FittedDamping,
    /// v' = a·v + g·u + b per joint, with a, g and b of each robot fitted to its context.
    LeastSquares,
    /// As `least-squares`, of a higher order and coupled to the torques of all joints where that
    /// predicts the end of the context better.
    Arx,
    /// The nominal arm, simulated.
    NominalSimulator,
    /// The same with the dampings of each robot fitted to its context through the simulator.
    SimulatorFittedDamping,
    /// The dynamic parameters of each robot fitted to its context through the simulator, from those of
    /// the nominal arm: what an expert with a model at hand would do.
    Identification,
}

impl Baseline {
    /// From the plainest to the one that knows most.
    pub fn all() -> Vec<Self> {
        vec![
            Self::HoldLast,
            Self::DampedIntegrator,
            Self::FittedDamping,
            Self::LeastSquares,
            Self::Arx,
            Self::NominalSimulator,
            Self::SimulatorFittedDamping,
            Self::Identification,
        ]
    }

    /// What it knows of the arms before it sees a context.
    pub const fn told(self) -> &'static str {
        match self {
            Self::HoldLast | Self::FittedDamping | Self::LeastSquares | Self::Arx => "nothing",
            Self::DampedIntegrator => "the nominal damping",
            Self::NominalSimulator => "the nominal arm",
            Self::SimulatorFittedDamping => "the nominal arm, how dampings vary",
            Self::Identification => "the nominal arm, how all of it varies",
        }
    }
}

/// Percentile bootstrap over scenarios for the 95 % intervals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bootstrap {
    pub resamples: u32,
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

fn noiseless() -> Vec<f64> {
    vec![0.0]
}

fn is_noiseless(levels: &[f64]) -> bool {
    levels == [0.0]
}

const fn one() -> u32 {
    1
}

const fn is_one(value: &u32) -> bool {
    *value == 1
}

const fn is_zero(value: &u64) -> bool {
    *value == 0
}

impl EvaluateSpec {
    /// Windows before the scored one.
    pub fn rounds(&self) -> u32 {
        self.rounds.unwrap_or(if self.starts_shifted() { ROUNDS } else { 0 })
    }

    /// Samples to predict, of trajectories with `samples`; 0 when they are too short for any.
    pub fn horizon(&self, samples: u32) -> u32 {
        let rest = samples.saturating_sub(self.context).saturating_sub(self.rounds());
        self.horizon.unwrap_or(rest)
    }

    pub(super) fn starts_shifted(&self) -> bool {
        self.samplers.iter().any(|sampler| sampler.start == Start::Shifted)
    }
}
