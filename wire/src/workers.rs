//! The processes that execute tasks.

use serde::{Deserialize, Serialize};
use spec::Resources;
use utoipa::ToSchema;

use crate::PlacementState;

/// A worker, as it showed itself last.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Worker {
    /// Unique among workers.
    pub name: String,
    /// The machine's name.
    pub host: String,
    pub pid: u32,
    /// The version of torqued.
    pub version: String,
    /// Models are computed on it.
    #[schema(example = "cpu")]
    pub device: String,
    /// Threads for computing.
    pub threads: u32,
    /// It takes tasks that ask for no more than this.
    #[serde(default)]
    pub offers: Resources,
    /// Whether it showed itself within 30 s.
    pub alive: bool,
    /// Since when it is to end the task that it has and claim no other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drained_at: Option<String>,
    /// Why it claims no tasks at the moment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waits_for: Option<String>,
    /// The task that it has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<WorkersTask>,
    /// As the engine shows it that placed it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<Placement>,
    pub started_at: String,
    pub seen_at: String,
}

impl Worker {
    /// For example `4 cpus, 1 gpu, 67.4 GB, a100`.
    pub fn offers_in_words(&self) -> String {
        let Resources { cpus, gpus, memory_gb, tags } = &self.offers;
        let count = |number: u32, what: &str| {
            let plural = if number == 1 { "" } else { "s" };
            format!("{number} {what}{plural}")
        };
        let mut parts = vec![count(cpus.unwrap_or(self.threads), "cpu")];
        parts.extend((*gpus > 0).then(|| count(*gpus, "gpu")));
        parts.extend(memory_gb.map(|memory| format!("{memory:.1} GB")));
        parts.extend(tags.iter().cloned());
        parts.join(", ")
    }
}

/// The task that a worker has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct WorkersTask {
    pub id: i64,
    pub job: i64,
    /// E.g. `shard 00003`.
    pub label: String,
}

/// What a cluster's engine says of a worker that was asked of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Placement {
    /// The worker's name.
    pub worker: String,
    #[schema(example = "Slurm")]
    pub engine: String,
    /// What the engine calls it: the number of a Slurm job, the name of a Pod.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identifier: Option<String>,
    pub state: PlacementState,
    /// Why it waits, or how it ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Where it runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<String>,
    pub asked_at: String,
    pub changed_at: String,
}

/// Workers by name: those that are there, and those that died within a day.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Workers {
    pub workers: Vec<Worker>,
    /// Workers that were asked of an engine and are not among `workers`: those that wait for their place, and those
    /// that ended within a day.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub placements: Vec<Placement>,
}
