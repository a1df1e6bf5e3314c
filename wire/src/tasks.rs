//! The pieces of a job that workers lease.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::{Progress, TaskState};

/// A piece of a job that one worker leases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Task {
    pub id: i64,
    /// Tasks of a stage wait for all tasks of the stages before.
    pub stage: u32,
    pub ordinal: u32,
    pub label: String,
    pub state: TaskState,
    /// Times it was claimed.
    pub attempt: u32,
    pub max_attempts: u32,
    /// The fencing number of its lease.
    pub epoch: i64,
    /// Who has it, or had it last.
    pub worker: Option<String>,
    pub lease_until: Option<String>,
    /// Why the last attempt that failed did.
    pub error: Option<String>,
    pub progress: Progress,
    /// What it reports of its work: a verification how a shard agrees, an import what became of the
    /// file. The resource that it made has the rest.
    #[schema(value_type = Option<Object>)]
    pub result: Option<Value>,
    pub started_at: Option<String>,
    pub finished_at: Option<String>,
}

/// All tasks of a job, in the order in which they run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Tasks {
    pub tasks: Vec<Task>,
}
