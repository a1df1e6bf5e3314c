//! Jobs and the members of pipelines.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec, Resources};
use utoipa::ToSchema;

use crate::{JobState, Jobs, List, ListCell, ListColumn, Listed, Sort, Tabled};

/// A job, with its progress and its results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Job {
    /// The id that paths and commands refer to it by.
    pub id: i64,
    /// The kind of work.
    pub kind: JobKind,
    /// The name that users gave it, or the name in its spec.
    pub name: String,
    /// A note in Markdown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Its tags, sorted.
    #[serde(default)]
    pub tags: Vec<String>,
    /// Whether it waits, runs or has ended.
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    /// The digest of its spec, without `execution`. Jobs with the same digest have the same
    /// results.
    pub digest: Digest,
    /// The spec with every default filled in and every reference resolved to a digest.
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// Warnings about values of the spec that are allowed but doubtful: field, value and reason.
    pub warnings: Vec<String>,
    /// The work done so far.
    pub progress: Progress,
    /// Jobs that must succeed first.
    pub needs: Vec<i64>,
    /// The jobs of a pipeline. Each comes after those it needs.
    pub members: Vec<Member>,
    /// The pipelines that it is a job of, the newest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pipelines: Vec<Membership>,
    /// The dataset that a simulation or import fills.
    pub dataset: Option<i64>,
    /// The dataset that a verification checks.
    pub verifies: Option<i64>,
    /// The record of a training, an evaluation or a control job.
    pub run: Option<i64>,
    /// The checkpoints that a training has made so far, oldest first.
    pub checkpoints: Vec<i64>,
    /// Tasks of jobs with a higher priority come first.
    pub priority: i32,
    /// Number of times that a task may be claimed before it fails.
    pub max_attempts: u32,
    /// Time limit of an attempt at a task, in seconds. It comes from the spec, or from the server's
    /// limit for this kind of job.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<u32>,
    /// The resources that a worker must offer to take a task.
    #[serde(default)]
    pub resources: Resources,
    /// No task begins before this time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_before: Option<String>,
    /// Why its queued tasks wait, besides waiting for their turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = "no worker offers gpus >= 1; start one with `torqued worker --gpus 1`")]
    pub waits_for: Option<String>,
    /// Whether the job ends as soon as its workers notice.
    pub cancel_requested: bool,
    /// When it was submitted: RFC 3339 in UTC, like all times.
    pub created_at: String,
    /// When its first task began. `null` before.
    pub started_at: Option<String>,
    /// When it ended. `null` before.
    pub finished_at: Option<String>,
    /// Seconds from the start to the end.
    pub duration_seconds: Option<f64>,
}

/// Work done and total work. For a pipeline: jobs that succeeded and all its jobs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Progress {
    /// The work done, in `unit`.
    pub done: u64,
    /// All of the work, in `unit`. It is 0 while it is not known.
    pub total: u64,
    /// The unit of the counts, e.g. `trajectories`.
    pub unit: String,
    /// Work per second of the running tasks, in `unit`. `null` while nothing is measured.
    pub rate_per_second: Option<f64>,
    /// A message of a running task.
    pub message: Option<String>,
}

impl Progress {
    /// The part of the work that is done.
    #[expect(clippy::cast_precision_loss, reason = "two digits are shown")]
    fn share(&self) -> ListCell {
        let share = |total: u64| 100.0 * (self.done as f64 / total as f64).min(1.0);
        ListCell::some(Some(self.total).filter(|total| *total > 0).map(share), ListCell::Percent)
    }
}

/// A job of a pipeline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Member {
    /// The name in the pipeline, by which other members refer to it.
    pub name: String,
    /// The id of the job.
    pub job: i64,
    /// The kind of work.
    pub kind: JobKind,
    /// Whether it waits, runs or has ended.
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    /// The work done so far.
    pub progress: Progress,
    /// Why its queued tasks wait, besides waiting for their turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub waits_for: Option<String>,
    /// Whether the job existed before the pipeline was submitted.
    pub reused: bool,
}

/// A pipeline that a job belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Membership {
    /// The pipeline's id.
    #[schema(example = 6)]
    pub id: i64,
    /// The pipeline's name.
    #[schema(example = "quickstart")]
    pub name: String,
    /// The job's name in the pipeline.
    #[schema(example = "train-lagrangian")]
    pub member: String,
}

impl Tabled for Job {
    const COLUMNS: &'static [ListColumn<Self>] = &[
        ListColumn::words("kind", |job| ListCell::text(job.kind)),
        ListColumn::words("state", |job| ListCell::state(job.state)),
        ListColumn::number("done", |job| job.progress.share()),
        ListColumn::number("submitted", |job| ListCell::moment(&job.created_at)),
        ListColumn::number("took", |job| {
            ListCell::span(job.started_at.as_ref(), job.finished_at.as_ref())
        }),
        ListColumn::words("waits", |job| ListCell::some(job.waits_for.as_ref(), ListCell::text)),
    ];
}

impl Listed for Job {
    const LIST: List = List {
        name: "jobs",
        empty: "A job is described in JSON.",
        kinds: JobKind::WORDS,
        only: None,
        states: &JobState::WORDS,
        sorts: &[Sort::Created, Sort::Finished, Sort::Name, Sort::Priority],
        has_labels: true,
        has_columns: false,
    };

    type Page = Jobs;

    fn id(&self) -> i64 {
        self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn tags(&self) -> Vec<&str> {
        self.tags.iter().map(String::as_str).collect()
    }
}
