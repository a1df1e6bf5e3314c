//! Jobs, their members and their tasks.

use serde_json::Value;
use spec::{JobKind, Product};
use store::{JobFilter, JobId, ShardSummary, Timestamp};
use wire::{Job, JobState, Jobs, Member, Progress, Task};

use crate::app::{App, Paging};
use crate::error::ApiError;

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

    /// The members of a pipeline, in order; none of any other job.
    pub async fn jobs_of_pipeline(&self, pipeline: i64) -> Result<Vec<Job>, ApiError> {
        let mut jobs = Vec::new();
        for member in self.store.members(JobId(pipeline)).await? {
            jobs.push(self.complete(member.job).await?);
        }
        Ok(jobs)
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
            warnings: jobs::warnings(&self.store, &row.spec, self.memory_doubts.as_deref()).await?,
            spec: row.spec,
            progress: progress(row.progress),
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
        for store::Member { name, job, reused } in rows {
            members.push(Member {
                name,
                job: job.id.0,
                kind: job.kind.parse()?,
                state: job.state,
                error: job.error,
                progress: progress(job.progress),
                reused,
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
            errors.remove("step_squares_deg2");
        }
    }
    (!entries.is_empty()).then_some(Value::Object(entries))
}

pub(super) fn text(time: Option<Timestamp>) -> Option<String> {
    time.map(|time| time.to_string())
}

fn progress(row: store::JobProgress) -> Progress {
    let store::JobProgress { done, total, unit, rate_per_second, message } = row;
    Progress { done, total, unit, rate_per_second, message }
}
