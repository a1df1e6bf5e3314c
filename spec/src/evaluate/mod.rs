//! An evaluation: who predicts what, and how the answers are scored.

mod cells;
mod default_grid;
mod inputs;
mod sampler;

use std::iter;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::check::{Check, Report};
use crate::kind::KindSpec;
use crate::{CheckpointRef, DataSource, Doubt, Execution, Reference, SpecError};

pub use cells::{ScenarioCell, UNGRIDDED_SCENARIOS};
pub use sampler::{EvaluationSampler, SamplerSteps, SamplingRun, Start};

/// Samples in the horizon where neither the spec nor its data says how many.
const HORIZON: u32 = 80;
/// Windows before the scored one, where a sampler goes on from its own predictions.
const ROUNDS: u32 = 8;
/// Samples of one scenario and predictor, at most.
const MAX_SAMPLES: u32 = 256;

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
    /// Key of the samples' noise.
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
            Self::Identification,
        ]
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

    fn starts_shifted(&self) -> bool {
        self.samplers.iter().any(|sampler| sampler.start == Start::Shifted)
    }
}

impl KindSpec for EvaluateSpec {
    fn read(fields: Map<String, Value>) -> Result<Self, SpecError> {
        default_grid::read(fields)
    }

    fn execution(&self) -> Execution {
        self.execution
    }

    fn references(&mut self) -> Vec<Reference<'_>> {
        let checkpoints = Reference::checkpoints(&mut self.checkpoints);
        iter::once(Reference::data(&mut self.data)).chain(checkpoints).collect()
    }

    fn doubts(&self) -> Vec<Doubt> {
        self.data.doubts()
    }
}

impl Check for EvaluateSpec {
    fn check(&self, report: &mut Report) {
        report.part("data", &self.data);
        if self.checkpoints.is_empty() && self.baselines.is_empty() {
            report.violation("checkpoints", "[]", "at least one checkpoint or baseline");
        }
        report.within("checkpoints", self.checkpoints.len(), 0..=50);
        if let Some(twice) = first_repeated(&self.checkpoints) {
            report.violation("checkpoints", format!("{twice:?} twice"), "each once");
        }
        if let Some(twice) = first_repeated(&self.baselines) {
            report.violation("baselines", format!("{twice:?} twice"), "each once");
        }
        report.within("context", self.context, 1..=9_999);
        if let Some(horizon) = self.horizon {
            report.within("horizon", horizon, 1..=9_999);
        }
        if let Some(rounds) = self.rounds {
            report.within("rounds", rounds, 0..=1000);
            if rounds == 0 && self.starts_shifted() {
                let allowed =
                    "1 to 1000 where a sampler starts shifted: its first window starts cold";
                report.violation("rounds", rounds, allowed);
            }
        }
        if let Some(scenarios) = self.scenarios {
            report.within("scenarios", scenarios, 1..=10_000);
        }
        report.within("samplers", self.samplers.len(), 0..=50);
        for (i, sampler) in self.samplers.iter().enumerate() {
            report.part(&format!("samplers[{i}]"), sampler);
        }
        report.within("samples", self.samples, 1..=MAX_SAMPLES);
        report.seed("seed", self.seed);
        if let Some(latency) = &self.latency {
            report.within("latency.repeats", latency.repeats, 20..=10_000);
        }
        report.within("bootstrap.resamples", self.bootstrap.resamples, 100..=100_000);
        report.seed("bootstrap.seed", self.bootstrap.seed);
        report.part("execution", &self.execution);
    }
}

fn first_repeated<T: PartialEq>(items: &[T]) -> Option<&T> {
    items.iter().enumerate().find(|(i, item)| items[..*i].contains(item)).map(|(_, item)| item)
}
