//! What attempts at tasks logged.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Lines that one attempt logged one after the other.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct LogChunk {
    /// Grows from chunk to chunk, whatever attempt logged them.
    pub id: i64,
    pub attempt: i64,
    pub task: i64,
    /// The task's, e.g. `shard 00003`.
    pub label: String,
    pub worker: String,
    /// Bytes that the attempt had logged before. Those between the end of a chunk and the position of the next were
    /// left out.
    pub position: u64,
    /// Whole lines, in UTF-8.
    pub text: String,
    pub written_at: String,
}

/// A page of the log of a job, or of all jobs of a pipeline, oldest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Logs {
    pub chunks: Vec<LogChunk>,
    /// The `after` of the chunks that follow, now or later.
    pub next: i64,
    /// The `before` of the page before this one.
    pub previous: Option<i64>,
    /// Nothing follows any more: what was asked about has ended, and this is its last page.
    pub complete: bool,
}

impl LogChunk {
    /// Bytes that the attempt had logged after this chunk.
    pub fn end(&self) -> u64 {
        self.position + self.text.len() as u64
    }
}

/// The line in the place of bytes that were left out.
pub fn left_out(bytes: u64) -> String {
    format!("... {bytes} bytes were left out here ...\n")
}
