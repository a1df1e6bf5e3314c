//! Workers: the processes that execute tasks.

use serde::{Deserialize, Serialize};
use spec::Resources;
use utoipa::ToSchema;

use crate::PlacementState;

/// A worker, as it last reported itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Worker {
    /// Unique among workers.
    pub name: String,
    /// The machine's name.
    pub host: String,
    /// The id of its process on that machine.
    pub pid: u32,
    /// The version of torqued.
    pub version: String,
    /// The device on which it computes models.
    #[schema(example = "cpu")]
    pub device: String,
    /// Number of threads for computing.
    pub threads: u32,
    /// It takes tasks that ask for no more than this.
    #[serde(default)]
    pub offers: Resources,
    /// Whether it reported within 30 s.
    pub alive: bool,
    /// The time since when it is drained: it ends its task and claims no other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drained_at: Option<String>,
    /// Why it claims no tasks at the moment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waits_for: Option<String>,
    /// The task that it has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<WorkersTask>,
    /// The state that its engine shows, if an engine placed it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<Placement>,
    /// When it started.
    pub started_at: String,
    /// When it last reported.
    pub seen_at: String,
}

impl Worker {
    /// Its offer in words, e.g. `4 cpus, 1 gpu, 67.4 GB, a100`.
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
    /// The id of the task.
    pub id: i64,
    /// The id of its job.
    pub job: i64,
    /// E.g. `shard 00003`.
    pub label: String,
}

/// A worker in the view of the cluster's engine that it was requested from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Placement {
    /// The worker's name.
    pub worker: String,
    /// The name of the engine.
    #[schema(example = "Slurm")]
    pub engine: String,
    /// The engine's name for it: the number of a Slurm job, or the name of a Pod.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identifier: Option<String>,
    /// Whether it waits for its place, runs or has ended.
    pub state: PlacementState,
    /// Why it waits, or how it ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The node on which it runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<String>,
    /// When it was requested.
    pub asked_at: String,
    /// When the state changed last.
    pub changed_at: String,
}

/// Workers sorted by name: live ones, and those that died within a day.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Workers {
    /// Those that have reported.
    pub workers: Vec<Worker>,
    /// Workers that were requested from an engine and are not among `workers`: those that wait for
    /// their place, and those that ended within a day.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub placements: Vec<Placement>,
}
