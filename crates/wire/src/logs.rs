//! Logs of attempts at tasks.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Consecutive lines in the log of one attempt.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LogChunk {
    /// Grows from chunk to chunk of a job, for all attempts together.
    pub id: i64,
    /// The id of the attempt.
    pub attempt: i64,
    /// The id of the task.
    pub task: i64,
    /// The task's label, e.g. `shard 00003`.
    pub label: String,
    /// The name of the worker.
    pub worker: String,
    /// Number of bytes that the attempt logged before. Bytes between the end of a chunk and the
    /// position of the next were dropped.
    pub position: u64,
    /// Whole lines, as UTF-8.
    pub text: String,
    /// When the server received it.
    pub written_at: String,
}

/// A page of the log of a job, or of all jobs of a pipeline; oldest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Logs {
    /// The lines of the page.
    pub chunks: Vec<LogChunk>,
    /// The `after` for the chunks that follow, now or later.
    pub next: i64,
    /// The `before` for the page before this one.
    pub previous: Option<i64>,
    /// Whether this is the last page: the selected attempts have ended, and no lines will follow.
    pub complete: bool,
}

impl LogChunk {
    /// Number of bytes that the attempt has logged up to the end of this chunk.
    pub fn end(&self) -> u64 {
        self.position + self.text.len() as u64
    }
}

/// The line that stands for dropped bytes.
pub fn left_out(bytes: u64) -> String {
    format!("... {bytes} bytes were left out here ...\n")
}
