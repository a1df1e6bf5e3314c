//! Attempts at tasks.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{AttemptOutcome, ListCell, ListColumn, Tabled};

/// One attempt of a worker at a task.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Attempt {
    /// Grows from attempt to attempt.
    pub id: i64,
    /// The id of the task.
    pub task: i64,
    /// The task's label, e.g. `shard 00003`.
    pub label: String,
    /// The fencing number of its lease.
    pub epoch: i64,
    /// The name of the worker.
    pub worker: String,
    /// Missing while the attempt is running.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<AttemptOutcome>,
    /// Why it failed, or why the worker had to give the task back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// When the worker claimed the task.
    pub started_at: String,
    /// When it ended. Missing while it is running.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_at: Option<String>,
    /// Path of its log. Missing while nothing was logged, and for old attempts, whose logs are
    /// deleted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<String>,
}

impl Tabled for Attempt {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::number("id", |attempt| ListCell::text(attempt.id)),
        ListColumn::words("task", |attempt| ListCell::text(&attempt.label)),
        ListColumn::words("worker", |attempt| ListCell::text(&attempt.worker)),
        ListColumn::number("started", |attempt| ListCell::moment(&attempt.started_at)),
        ListColumn::number("took", |attempt| {
            ListCell::span(Some(&attempt.started_at), attempt.ended_at.as_ref())
        }),
        ListColumn::words("ended", |attempt| {
            ListCell::text(attempt.outcome.map_or("still running", AttemptOutcome::as_str))
        }),
        ListColumn::words("because", |attempt| {
            ListCell::some(attempt.reason.as_ref(), ListCell::text)
        }),
    ];
}

/// A page of attempts, newest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Attempts {
    /// The attempts of the page.
    pub attempts: Vec<Attempt>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}
