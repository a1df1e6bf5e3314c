//! Jobs, their members and their tasks.

use serde::Serialize;
use serde_json::Value;
use spec::{Digest, JobKind, JobSpec, Product};
use store::{JobId, ShardSummary, Timestamp};
use utoipa::ToSchema;

use crate::app::{App, Paging};
use crate::error::ApiError;

pub use store::{JobFilter, JobState, TaskState};

/// A job, how far it is and what it has made.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Job {
    pub id: i64,
    pub kind: JobKind,
    pub name: String,
    #[schema(value_type = String, example = "running")]
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    pub digest: Digest,
    /// With every default filled in and every reference resolved to a digest.
    #[schema(value_type = JobSpec)]
    pub spec: Value,
    /// What of the spec is doubtful, though it is allowed: field, value and reason.
    pub warnings: Vec<String>,
    pub progress: Progress,
    /// Jobs that must succeed first.
    pub needs: Vec<i64>,
    /// The jobs of a pipeline, each after those it needs.
    pub members: Vec<Member>,
    /// What a simulation or import fills.
    pub dataset: Option<i64>,
    /// The dataset that a verification makes again and compares.
    pub verifies: Option<i64>,
    /// The record of a training or evaluation.
    pub run: Option<i64>,
    /// What a training has made so far, oldest first.
    pub checkpoints: Vec<i64>,
    pub priority: i32,
    /// Times a task may be claimed before it fails.
    pub max_attempts: u32,
    /// It ends as soon as its workers notice.
    pub cancel_requested: bool,
    /// RFC 3339, UTC, like the other times.
    pub created_at: String,
    pub started_at: Option<String>,
    pub finished_at: Option<String>,
    /// From start to end.
    pub duration_seconds: Option<f64>,
}

/// Work done of work to do; of a pipeline, jobs that succeeded of all its jobs.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Progress {
    pub done: u64,
    pub total: u64,
    /// What is counted, e.g. `trajectories`.
    pub unit: String,
    pub rate_per_second: Option<f64>,
    pub message: Option<String>,
}

/// A job of a pipeline, seen from the pipeline.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Member {
    pub name: String,
    pub job: i64,
    pub kind: JobKind,
    #[schema(value_type = String, example = "queued")]
    pub state: JobState,
    pub error: Option<String>,
    pub progress: Progress,
    /// It was there before the pipeline was submitted.
    pub reused: bool,
}

/// A piece of a job that one worker leases.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Task {
    pub id: i64,
    /// Tasks of a stage wait for all tasks of the stages before.
    pub stage: u32,
    pub ordinal: u32,
    pub label: String,
    #[schema(value_type = String, example = "running")]
    pub state: TaskState,
    /// Times it was claimed.
    pub attempt: u32,
    pub max_attempts: u32,
    /// The fencing number of its lease.
    pub epoch: i64,
    /// Who has it, or had it last.
    pub worker: Option<String>,
    pub lease_until: Option<String>,
    /// Of the last attempt that failed.
    pub error: Option<String>,
    pub progress: Progress,
    /// What it has to say of what it did: a verification how a shard agrees, an import what became
    /// of the file. What it made is told where that is.
    #[schema(value_type = Option<Object>)]
    pub result: Option<Value>,
    pub started_at: Option<String>,
    pub finished_at: Option<String>,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Jobs {
    pub jobs: Vec<Job>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Tasks {
    pub tasks: Vec<Task>,
}

impl App {
    pub async fn job(&self, id: i64) -> Result<Job, ApiError> {
        let row = self.store.job(JobId(id)).await?;
        self.complete(row).await
    }

    pub async fn jobs(&self, filter: JobFilter<'_>, paging: Paging) -> Result<Jobs, ApiError> {
        let rows = self.store.jobs(filter, paging.into()).await?;
        let next = paging.next(rows.len(), rows.last().map(|row| row.id.0));
        let mut jobs = Vec::with_capacity(rows.len());
        for row in rows {
            jobs.push(self.complete(row).await?);
        }
        Ok(Jobs { jobs, next })
    }

    pub async fn tasks(&self, job: i64) -> Result<Vec<Task>, ApiError> {
        let unit = self.store.job(JobId(job)).await?.progress.unit;
        let rows = self.store.tasks(JobId(job)).await?;
        Ok(rows.into_iter().map(|row| task(row, &unit)).collect())
    }

    /// Cancels a job; one that was cancelled before stays so.
    pub async fn cancel(&self, id: i64) -> Result<Job, ApiError> {
        let before = self.store.job(JobId(id)).await?;
        if matches!(before.state, JobState::Succeeded | JobState::Failed) {
            return Err(ApiError::AlreadyFinal { id, state: before.state });
        }
        self.store.cancel(JobId(id)).await?;
        self.job(id).await
    }

    /// Adds to a job what other tables know of it.
    pub(super) async fn complete(&self, row: store::Job) -> Result<Job, ApiError> {
        let kind: JobKind = row.kind.parse()?;
        let members = match kind {
            JobKind::Pipeline => self.members(row.id).await?,
            _ => Vec::new(),
        };
        let checkpoints = match kind.makes() {
            Some(Product::Checkpoints) => self.store.checkpoints_of_job(row.id).await?,
            _ => Vec::new(),
        };
        let needs = self.store.needs(row.id).await?;
        let verifies = match (kind, needs.first()) {
            (JobKind::Verify, Some(need)) => self.store.job(*need).await?.dataset,
            _ => None,
        };
        Ok(Job {
            duration_seconds: duration_seconds(&row),
            id: row.id.0,
            kind,
            name: row.name,
            state: row.state,
            error: row.error,
            digest: row.digest,
            warnings: jobs::warnings(&self.store, &row.spec, self.memory_bytes).await?,
            spec: row.spec,
            progress: row.progress.into(),
            needs: needs.into_iter().map(|need| need.0).collect(),
            members,
            dataset: row.dataset.map(|id| id.0),
            verifies: verifies.map(|id| id.0),
            run: row.run.map(|id| id.0),
            checkpoints: checkpoints.into_iter().map(|checkpoint| checkpoint.id.0).collect(),
            priority: row.priority,
            max_attempts: row.max_attempts,
            cancel_requested: row.cancel_requested,
            created_at: row.created_at.to_string(),
            started_at: text(row.started_at),
            finished_at: text(row.finished_at),
        })
    }

    async fn members(&self, pipeline: JobId) -> Result<Vec<Member>, ApiError> {
        let rows = self.store.members(pipeline).await?;
        let mut members = Vec::with_capacity(rows.len());
        for row in rows {
            let progress = self.store.job(row.job).await?.progress.into();
            members.push(Member {
                name: row.name,
                job: row.job.0,
                kind: row.kind.parse()?,
                state: row.state,
                error: row.error,
                progress,
                reused: row.reused,
            });
        }
        Ok(members)
    }
}

/// From start to end, in seconds, once both are known.
#[expect(clippy::cast_precision_loss, reason = "milliseconds of a job are exact in f64")]
fn duration_seconds(row: &store::Job) -> Option<f64> {
    let (started, finished) = (row.started_at?, row.finished_at?);
    Some((finished.milliseconds() - started.milliseconds()) as f64 / 1000.0)
}

fn task(row: store::Task, unit: &str) -> Task {
    Task {
        id: row.id.0,
        stage: row.stage,
        ordinal: row.ordinal,
        label: row.label,
        state: row.state,
        attempt: row.attempt,
        max_attempts: row.max_attempts,
        epoch: row.epoch.0,
        worker: row.worker,
        lease_until: text(row.lease_until),
        error: row.error,
        progress: Progress {
            done: row.progress.done,
            total: row.total,
            unit: unit.to_owned(),
            rate_per_second: row.progress.rate_per_second,
            message: row.progress.message,
        },
        result: row.result.and_then(without_details),
        started_at: text(row.started_at),
        finished_at: text(row.finished_at),
    }
}

/// The ranges and spectra of a shard belong to its dataset, whose summary has those of all shards;
/// the errors of a cell joint by joint belong to its evaluation's report.
fn without_details(result: Value) -> Option<Value> {
    let Value::Object(mut entries) = result else { return Some(result) };
    entries.remove(ShardSummary::KEY);
    if let Some(Value::Array(predictors)) = entries.get_mut("predictors") {
        for errors in predictors.iter_mut().filter_map(Value::as_object_mut) {
            errors.remove("scenarios");
            errors.remove("step_squares_deg2");
        }
    }
    (!entries.is_empty()).then_some(Value::Object(entries))
}

pub(super) fn text(time: Option<Timestamp>) -> Option<String> {
    time.map(|time| time.to_string())
}

impl From<store::JobProgress> for Progress {
    fn from(progress: store::JobProgress) -> Self {
        Self {
            done: progress.done,
            total: progress.total,
            unit: progress.unit,
            rate_per_second: progress.rate_per_second,
            message: progress.message,
        }
    }
}
