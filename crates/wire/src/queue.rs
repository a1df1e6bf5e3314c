//! The queue as a whole.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Whether tasks are claimed, and how many there are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Queue {
    /// Whether the queue is paused: no task is claimed until somebody resumes it.
    pub paused: bool,
    /// The time since when it is paused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paused_at: Option<String>,
    /// Number of tasks that wait for a worker.
    pub queued: u64,
    /// Number of tasks that workers have.
    pub running: u64,
}
