//! Jobs, as they are looked up.

use serde_json::Value;
use spec::{Digest, Moment, Resources};
use wire::JobState;

use crate::boxed;
use crate::database::sql;
use crate::trash::refuse_deleted;
use crate::{DatasetId, Deletion, JobId, Listing, RunId, Store, StoreError, Timestamp};

#[derive(Clone, Debug)]
pub struct Job {
    pub id: JobId,
    /// Opaque to the store.
    pub kind: String,
    /// As people call it, or else as it was submitted.
    pub name: String,
    /// Only where people have called it otherwise.
    pub given_name: Option<String>,
    pub note: Option<String>,
    /// In order.
    pub tags: Vec<String>,
    /// Resolved: every default filled in, every reference a digest.
    pub spec: Value,
    pub digest: Digest,
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    pub priority: i32,
    pub max_attempts: u32,
    /// How long an attempt at a task may take, in seconds.
    pub time_limit_s: Option<u32>,
    /// What a worker must offer to take a task of it.
    pub resources: Resources,
    /// No task of it is claimed before.
    pub not_before: Option<Moment>,
    pub cancel_requested: bool,
    pub progress: JobProgress,
    /// The dataset that it fills, if it fills one.
    pub dataset: Option<DatasetId>,
    /// Its record, if it leaves one.
    pub run: Option<RunId>,
    pub created_at: Timestamp,
    pub started_at: Option<Timestamp>,
    pub finished_at: Option<Timestamp>,
    pub deletion: Option<Deletion>,
}

/// Work done of work to do, over all tasks; of a pipeline, jobs that succeeded of all its jobs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JobProgress {
    pub done: u64,
    pub total: u64,
    /// What is counted, e.g. `trajectories`.
    pub unit: String,
    /// Of all running tasks together.
    pub rate_per_second: Option<f64>,
    /// What a running task says of itself.
    pub message: Option<String>,
}

/// Part of a list, newest first.
#[derive(Clone, Copy, Debug)]
pub struct Page {
    /// Only ids below this one: the last of the page before.
    pub before: Option<i64>,
    /// At most 500.
    pub limit: u32,
}

impl Page {
    /// Items of a page.
    pub const MAX_LIMIT: u32 = 500;

    pub(crate) fn before(self) -> i64 {
        self.before.unwrap_or(i64::MAX)
    }

    pub(crate) fn limit(self) -> i64 {
        i64::from(self.limit.min(Self::MAX_LIMIT))
    }
}

impl Default for Page {
    fn default() -> Self {
        Self { before: None, limit: 50 }
    }
}

#[derive(Clone, Copy, Debug, Default)]
pub struct JobFilter<'a> {
    pub kind: Option<&'a str>,
    pub state: Option<JobState>,
}

impl Store {
    /// # Errors
    /// When there is no such job, or it was deleted.
    #[boxed]
    pub async fn job(&self, id: JobId) -> Result<Job, StoreError> {
        let found = sql!(self.database(), READING, job(id))?
            .ok_or_else(|| StoreError::not_found("job", id.to_string()))?;
        refuse_deleted(id, found.deletion.as_ref())?;
        Ok(found)
    }

    /// Newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn jobs(&self, filter: JobFilter<'_>, page: Page) -> Result<Vec<Job>, StoreError> {
        let kind = filter.kind.map(str::to_owned);
        let state = filter.state.map(|state| state.as_str().to_owned());
        Ok(self.list_jobs(&Listing { kind, state, ..page.into() }).await?.items)
    }

    /// Pipelines, and jobs that were not made for one, newest first; all states without a `state`.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn experiments(
        &self,
        state: Option<JobState>,
        page: Page,
    ) -> Result<Vec<Job>, StoreError> {
        let state = state.map(|state| state.as_str().to_owned());
        let listing = Listing { state, experiments_alone: true, ..page.into() };
        Ok(self.list_jobs(&listing).await?.items)
    }

    /// The newest job of a digest in one of `states`, a deleted one, too, which still says what the digest means.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn job_by_digest(
        &self,
        digest: Digest,
        states: &[JobState],
    ) -> Result<Option<Job>, StoreError> {
        sql!(self.database(), READING, job_by_digest(digest, states))
    }

    /// The same, of those whose results are there or can still come.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn usable_job_by_digest(
        &self,
        digest: Digest,
        states: &[JobState],
    ) -> Result<Option<Job>, StoreError> {
        sql!(self.database(), READING, usable_job_by_digest(digest, states))
    }

    /// The newest job of `kind` that needs the job of this very dataset, not of another with its
    /// digest.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn newest_reader(
        &self,
        dataset: DatasetId,
        kind: &str,
    ) -> Result<Option<Job>, StoreError> {
        sql!(self.database(), READING, newest_reader(dataset, kind))
    }

    /// Those of the jobs with these ids that there are, by id.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn jobs_by_id(&self, ids: &[JobId]) -> Result<Vec<Job>, StoreError> {
        sql!(self.database(), READING, jobs_by_id(ids))
    }

    /// The specs of the jobs with these ids.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn specs(&self, ids: &[JobId]) -> Result<Vec<(JobId, Value)>, StoreError> {
        sql!(self.database(), READING, specs(ids))
    }

    /// The spec of the newest job of each digest, whatever became of it.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn newest_specs(
        &self,
        digests: &[Digest],
    ) -> Result<Vec<(Digest, Value)>, StoreError> {
        sql!(self.database(), READING, newest_specs(digests))
    }

    /// Each of `jobs` beside every job that must succeed before it can start, in the order of both ids.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn needs(&self, jobs: &[JobId]) -> Result<Vec<(JobId, JobId)>, StoreError> {
        sql!(self.database(), "reading the needs of jobs", needs(jobs))
    }
}

const READING: &str = "reading jobs";
