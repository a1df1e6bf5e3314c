//! Tasks: the pieces of a job that workers lease.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::{ListCell, ListColumn, Progress, Tabled, TaskState};

/// A piece of a job that one worker leases.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Task {
    /// The id, by which attempts and logs name it.
    pub id: i64,
    /// Tasks of a stage wait for all tasks of earlier stages.
    pub stage: u32,
    /// Its place within the stage, from 0.
    pub ordinal: u32,
    /// Its part of the job, e.g. `shard 00003`.
    pub label: String,
    /// Whether it waits, runs or has ended.
    pub state: TaskState,
    /// Number of claims since it last made progress, e.g. with a checkpoint of a later step.
    pub attempt: u32,
    /// Number of claims after which it fails.
    pub max_attempts: u32,
    /// The fencing number of its lease.
    pub epoch: i64,
    /// The worker that has it, or had it last.
    pub worker: Option<String>,
    /// When the lease ends unless the worker renews it. `null` while no worker has it.
    pub lease_until: Option<String>,
    /// The error of the last attempt that failed.
    pub error: Option<String>,
    /// The work done so far.
    pub progress: Progress,
    /// Its result, e.g. the comparison of a verified shard, or the counts of an import. Other
    /// results are in the resource that the task made.
    #[schema(value_type = Option<Object>)]
    pub result: Option<Value>,
    /// When its last attempt began. `null` before the first.
    pub started_at: Option<String>,
    /// When it ended. `null` before.
    pub finished_at: Option<String>,
}

impl Tabled for Task {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::number("id", |task| ListCell::text(task.id)),
        ListColumn::number("stage", |task| ListCell::text(task.stage)),
        ListColumn::words("task", |task| ListCell::text(&task.label)),
        ListColumn::words("state", |task| ListCell::text(task.state)),
        ListColumn::number("done", |task| ListCell::part(task.progress.done, task.progress.total)),
        ListColumn::number("attempt", |task| {
            ListCell::Part(task.attempt.into(), task.max_attempts.into())
        }),
        ListColumn::words("worker", |task| ListCell::some(task.worker.as_ref(), ListCell::text)),
        ListColumn::number("took", |task| {
            ListCell::span(task.started_at.as_ref(), task.finished_at.as_ref())
        }),
        ListColumn::words("error", |task| ListCell::some(task.error.as_ref(), ListCell::text)),
    ];
}

/// A page of a job's tasks, in the order in which they run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Tasks {
    /// The tasks of the page.
    pub tasks: Vec<Task>,
    /// The `after` of the following page.
    pub next: Option<i64>,
}

/// The findings of a job with these tasks: those of the task in its last stage. `None` if that
/// stage has several tasks.
pub fn findings(tasks: &[Task]) -> Option<String> {
    let last = tasks.last()?;
    let of_stage = tasks.iter().filter(|task| task.stage == last.stage).count();
    last.result.as_ref().filter(|_| of_stage == 1).and_then(findings_of)
}

/// The numbers and words of a result, e.g. `trajectories 1000, samples 400`.
pub fn findings_of(result: &Value) -> Option<String> {
    let plain = result.as_object()?.iter().filter_map(|(name, value)| {
        let value = match value {
            Value::String(text) => text.clone(),
            Value::Number(_) | Value::Bool(_) => value.to_string(),
            Value::Null | Value::Array(_) | Value::Object(_) => return None,
        };
        Some(format!("{} {value}", name.replace('_', " ")))
    });
    Some(plain.collect::<Vec<_>>().join(", ")).filter(|text| !text.is_empty())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn tasks(results: &[(u32, Value)]) -> Vec<Task> {
        let task = |(stage, result): &(u32, Value)| Task {
            id: 1,
            stage: *stage,
            ordinal: 0,
            label: "task".to_owned(),
            state: TaskState::Succeeded,
            attempt: 1,
            max_attempts: 3,
            epoch: 1,
            worker: None,
            lease_until: None,
            error: None,
            progress: Progress::default(),
            result: Some(result.clone()),
            started_at: None,
            finished_at: None,
        };
        results.iter().map(task).collect()
    }

    #[test]
    fn the_only_task_of_the_last_stage_speaks_for_the_job() {
        let count = json!({"shortest_s": 1.5, "trajectories": 7, "each": [1, 2]});
        let found = findings(&tasks(&[(0, json!({"part": 1})), (1, count.clone())]));
        assert_eq!(found.as_deref(), Some("shortest s 1.5, trajectories 7"));
        assert_eq!(findings(&tasks(&[(0, count.clone()), (0, count)])), None);
    }
}
