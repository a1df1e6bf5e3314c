//! The processes that execute tasks.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A worker, as it showed itself last.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
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
    /// Whether it showed itself within 30 s.
    pub alive: bool,
    /// Why it claims no tasks at the moment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waits_for: Option<String>,
    /// The task that it has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub task: Option<WorkersTask>,
    pub started_at: String,
    pub seen_at: String,
}

/// The task that a worker has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct WorkersTask {
    pub id: i64,
    pub job: i64,
    /// E.g. `shard 00003`.
    pub label: String,
}

/// Workers by name: those that are there, and those that died within a day.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Workers {
    pub workers: Vec<Worker>,
}
