//! Server-sent events about jobs.

use serde::{Deserialize, Serialize};
use spec::JobKind;
use utoipa::ToSchema;

use crate::{DeletionChange, ItemKind, JobState, Member, Progress, TaskState};

/// The data of a server-sent event. Its field `event` is also the event's type. Events with an `id`
/// are kept for a while, and a client can read them again from any id on. Clients ignore kinds that
/// they do not know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "event", rename_all = "lowercase")]
#[expect(missing_docs, reason = "the type of each variant says what happened")]
pub enum Event {
    Job(JobEvent),
    Task(TaskEvent),
    Metrics(MetricsEvent),
    Checkpoint(CheckpointEvent),
    Deletion(DeletionEvent),
    Progress(JobProgress),
    Gap(EventGap),
    End(EventEnd),
}

/// A job was created, its state changed, or its cancellation was requested.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobEvent {
    /// Ids grow in the order of events.
    pub id: i64,
    /// When it happened.
    pub at: String,
    /// The id of the job.
    pub job: i64,
    /// The kind of the job.
    pub kind: JobKind,
    /// The name of the job.
    pub name: String,
    /// The job's new state.
    pub state: JobState,
    /// Why the job failed or was cancelled.
    pub error: Option<String>,
    /// Whether somebody asked for its cancellation.
    pub cancel_requested: bool,
}

/// A worker began a task, or the task ended. The state is `queued` again when the task is retried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TaskEvent {
    /// Ids grow in the order of events.
    pub id: i64,
    /// When it happened.
    pub at: String,
    /// The id of the job.
    pub job: i64,
    /// The id of the task.
    pub task: i64,
    /// The task's label, e.g. `shard 00003`.
    pub label: String,
    /// The task's new state.
    pub state: TaskState,
    /// Number of claims since the task last made progress.
    pub attempt: u32,
    /// The worker that has the task, or had it last.
    pub worker: Option<String>,
    /// The error of the last attempt that failed.
    pub error: Option<String>,
}

/// A run recorded metrics. There is one event for all metrics that a worker wrote at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MetricsEvent {
    /// Ids grow in the order of events.
    pub id: i64,
    /// When it happened.
    pub at: String,
    /// The job of the run.
    pub job: i64,
    /// The id of the run.
    pub run: i64,
    /// The largest step among them.
    pub step: u64,
}

/// A training wrote a checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CheckpointEvent {
    /// Ids grow in the order of events.
    pub id: i64,
    /// When it happened.
    pub at: String,
    /// The training.
    pub job: i64,
    /// The run of the training.
    pub run: i64,
    /// The id of the checkpoint.
    pub checkpoint: i64,
    /// Optimizer steps taken.
    pub step: u64,
    /// Whether the training ended with it.
    pub is_final: bool,
    /// Whether it has the best validation so far.
    pub is_best: bool,
}

/// An item was moved into the trash, restored, or deleted permanently. Each item that is deleted
/// with it has its own event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DeletionEvent {
    /// Ids grow in the order of events.
    pub id: i64,
    /// When it happened.
    pub at: String,
    /// The item itself if it is a job, and otherwise the job that made it.
    pub job: i64,
    /// The kind of the item.
    pub item: ItemKind,
    /// The id of the item among those of its kind.
    pub item_id: i64,
    /// Whether it was moved into the trash, restored or deleted for good.
    pub change: DeletionChange,
}

/// The present state of a job. It is sent when a stream begins, and then after changes, about once
/// a second. It is not kept and has no id.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobProgress {
    /// The id of the job.
    pub job: i64,
    /// The state of the job.
    pub state: JobState,
    /// Why the job failed or was cancelled.
    pub error: Option<String>,
    /// Whether somebody asked for its cancellation.
    pub cancel_requested: bool,
    /// The work done so far.
    pub progress: Progress,
    /// Why its queued tasks wait, besides waiting for their turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waits_for: Option<String>,
    /// The jobs of a pipeline.
    pub members: Vec<Member>,
}

/// Some events are missing: those after `after` up to `id` are no longer kept, or `after` is not an
/// id of this database. Read the state of your jobs again, and continue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EventGap {
    /// Later events have larger ids.
    pub id: i64,
    /// The id that the client asked for.
    pub after: i64,
}

/// The job has its final state, and its stream ends. Do not connect again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EventEnd {
    /// The id of the job.
    pub job: i64,
    /// `succeeded`, `failed` or `cancelled`.
    pub state: JobState,
    /// Why the job failed or was cancelled.
    pub error: Option<String>,
}

impl Event {
    /// The event's type, as in its JSON.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Job(_) => "job",
            Self::Task(_) => "task",
            Self::Metrics(_) => "metrics",
            Self::Checkpoint(_) => "checkpoint",
            Self::Deletion(_) => "deletion",
            Self::Progress(_) => "progress",
            Self::Gap(_) => "gap",
            Self::End(_) => "end",
        }
    }

    /// The id after which a client can continue, if the event has one.
    pub const fn id(&self) -> Option<i64> {
        match self {
            Self::Job(event) => Some(event.id),
            Self::Task(event) => Some(event.id),
            Self::Metrics(event) => Some(event.id),
            Self::Checkpoint(event) => Some(event.id),
            Self::Deletion(event) => Some(event.id),
            Self::Gap(event) => Some(event.id),
            Self::Progress(_) | Self::End(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_names_its_kind_in_its_data() {
        let gap = Event::Gap(EventGap { id: 7, after: 3 });
        let data = serde_json::to_value(&gap).unwrap();
        assert_eq!(data, serde_json::json!({"event": "gap", "id": 7, "after": 3}));
        assert_eq!(data["event"], gap.name());
        assert_eq!(serde_json::from_value::<Event>(data).unwrap(), gap);
    }
}
