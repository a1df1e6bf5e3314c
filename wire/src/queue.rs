//! The queue as a whole.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Whether tasks are claimed, and how many there are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Queue {
    /// Whether no task is claimed until somebody resumes the queue.
    pub paused: bool,
    /// Since when.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paused_at: Option<String>,
    /// Tasks that wait for a worker.
    pub queued: u64,
    /// Tasks that workers have.
    pub running: u64,
}
