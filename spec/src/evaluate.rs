use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Report};
use crate::{CheckpointRef, DataSource, Execution};

/// Compare predictors on the same scenarios, one cell per frequency of the dataset's grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluateSpec {
    /// Simulated over a frequency grid.
    pub data: DataSource,
    #[serde(default)]
    pub checkpoints: Vec<CheckpointRef>,
    #[serde(default = "Baseline::all")]
    pub baselines: Vec<Baseline>,
    /// Samples every predictor is given.
    #[serde(default = "context")]
    pub context: u32,
    #[serde(default)]
    pub bootstrap: Bootstrap,
    #[serde(default, skip_serializing_if = "Execution::is_default")]
    pub execution: Execution,
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
        report.within("bootstrap.resamples", self.bootstrap.resamples, 100..=100_000);
        report.seed("bootstrap.seed", self.bootstrap.seed);
        report.part("execution", &self.execution);
    }
}

fn first_repeated<T: PartialEq>(items: &[T]) -> Option<&T> {
    items.iter().enumerate().find(|(i, item)| items[..*i].contains(item)).map(|(_, item)| item)
}
