//! Attempts at tasks.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::AttemptOutcome;

/// One attempt of a worker at a task.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Attempt {
    pub id: i64,
    pub task: i64,
    /// The task's label, e.g. `shard 00003`.
    pub label: String,
    /// The fencing number of its lease.
    pub epoch: i64,
    pub worker: String,
    /// Missing while the attempt is running.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<AttemptOutcome>,
    /// Why it failed, or why the worker had to give the task back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    pub started_at: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_at: Option<String>,
    /// Path of its log. Missing while nothing was logged, and for old attempts, whose logs are
    /// deleted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
}

/// A page of attempts, newest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Attempts {
    pub attempts: Vec<Attempt>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}
