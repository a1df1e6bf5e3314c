//! Looking up jobs.

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
    /// The store does not interpret it.
    pub kind: String,
    /// The name that users gave it, or the name it was submitted with.
    pub name: String,
    /// The name that users gave it, if they gave one.
    pub given_name: Option<String>,
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Resolved: every default filled in, every reference a digest.
    pub spec: Value,
    pub digest: Digest,
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    pub priority: i32,
    pub max_attempts: u32,
    /// Time limit of an attempt at a task, in seconds.
    pub time_limit_s: Option<u32>,
    /// The resources that a worker must offer to take one of its tasks.
    pub resources: Resources,
    /// None of its tasks is claimed before this moment.
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

/// Progress of a job: work done and total work over all tasks. For a pipeline, jobs that succeeded
/// and all its jobs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JobProgress {
    pub done: u64,
    pub total: u64,
    /// The unit of the counts, e.g. `trajectories`.
    pub unit: String,
    /// Rate of all running tasks together.
    pub rate_per_second: Option<f64>,
    /// A message of a running task.
    pub message: Option<String>,
}

/// A page of a list, newest first.
#[derive(Clone, Copy, Debug)]
pub struct Page {
    /// Only ids below this one. Pass the last id of the page before.
    pub before: Option<i64>,
    /// Number of items, 500 at most.
    pub limit: u32,
}

impl Page {
    /// The largest number of items on a page.
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

    /// Jobs, newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn jobs(&self, filter: JobFilter<'_>, page: Page) -> Result<Vec<Job>, StoreError> {
        let kind = filter.kind.map(str::to_owned);
        let state = filter.state.map(|state| state.as_str().to_owned());
        Ok(self.list_jobs(&Listing { kind, state, ..page.into() }).await?.items)
    }

    /// Pipelines, and jobs that do not belong to one, newest first; in every state if `state` is
    /// `None`.
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

    /// The newest job with this digest in one of `states`. It may be a deleted job, because its
    /// spec still says what the digest means.
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

    /// The newest job with this digest in one of `states` whose results exist or can still come.
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

    /// The newest job of `kind` that needs the job of this dataset. Jobs that need another dataset
    /// with the same digest do not count.
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

    /// Those of the jobs with these ids that exist, sorted by id.
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

    /// The spec of the newest job of each digest, in whatever state the job is.
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

    /// Pairs of a job of `jobs` and a job that must succeed before it can start, sorted by both
    /// ids.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn needs(&self, jobs: &[JobId]) -> Result<Vec<(JobId, JobId)>, StoreError> {
        sql!(self.database(), "reading the needs of jobs", needs(jobs))
    }
}

const READING: &str = "reading jobs";
