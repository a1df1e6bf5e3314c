//! Every time that a worker had a task.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::AttemptOutcome;

/// One time that a worker had a task.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Attempt {
    pub id: i64,
    pub task: i64,
    /// The task's, e.g. `shard 00003`.
    pub label: String,
    /// The fencing number of its lease.
    pub epoch: i64,
    pub worker: String,
    /// Missing while it lasts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<AttemptOutcome>,
    /// Why it failed, or why the worker had to give the task back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    pub started_at: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_at: Option<String>,
    /// Where its log is. Missing while it has logged nothing, and of old attempts, whose logs are not kept.
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
