//! Looking up jobs.

use std::collections::HashMap;

use serde_json::Value;
use spec::{Digest, Execution};
use wire::JobState;

use crate::database::column::json;
use crate::database::query::{FromRow, Query, Row, from_row, sql};
use crate::database::rows::{deletion, tags};
use crate::database::{Reading, Transaction};
use crate::lists::listing::Listed;
use crate::trash::refuse_deleted;
use crate::{
    DatasetId, Deletion, ItemKind, JobId, Listing, RunId, Store, StoreError, Timestamp, boxed,
};

/// A job as it is now, with its progress and the ids of its results.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its id, which URLs and commands use.
    pub id: JobId,
    /// The store does not interpret it.
    pub kind: String,
    /// The name that users gave it, or the name it was submitted with.
    pub name: String,
    /// The name that users gave it, if they gave one.
    pub given_name: Option<String>,
    /// A note in Markdown.
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Resolved: every default filled in, every reference a digest.
    pub spec: Value,
    /// The digest of what it computes. Jobs with the same digest have the same results.
    pub digest: Digest,
    /// Where it stands between its submission and its end.
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    /// The place in line, the attempts and the needed resources of its tasks.
    pub execution: Execution,
    /// Whether it ends as soon as its workers notice.
    pub cancel_requested: bool,
    /// How much of its work is done.
    pub progress: JobProgress,
    /// The dataset that it fills, if it fills one.
    pub dataset: Option<DatasetId>,
    /// Its record, if it leaves one.
    pub run: Option<RunId>,
    /// When it was submitted.
    pub created_at: Timestamp,
    /// When a worker first claimed one of its tasks.
    pub started_at: Option<Timestamp>,
    /// When it reached a final state.
    pub finished_at: Option<Timestamp>,
    /// When it was moved to the trash; `None` if it was not.
    pub deletion: Option<Deletion>,
}

/// Progress of a job: work done and total work over all tasks. For a pipeline, jobs that succeeded
/// and all its jobs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JobProgress {
    /// Work that is done, in `unit`.
    pub done: u64,
    /// All work, in `unit`; 0 while it is not known.
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

/// A choice of jobs. Nothing is left out by default.
#[derive(Clone, Copy, Debug, Default)]
pub struct JobFilter<'a> {
    /// Jobs of this kind alone.
    pub kind: Option<&'a str>,
    /// Jobs in this state alone.
    pub state: Option<JobState>,
}

impl Store {
    /// A page of the list of jobs.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_jobs(&self, listing: &Listing) -> Result<Listed<Job>, StoreError> {
        let found = self.found(ItemKind::Job, listing).await?;
        let ids: Vec<JobId> = found.ids.iter().copied().map(JobId).collect();
        let rows = self.jobs_by_id(&ids).await?;
        Ok(found.with(rows, |job| job.id.0))
    }

    /// # Errors
    /// When there is no such job, or it was deleted.
    #[boxed]
    pub async fn job(&self, id: JobId) -> Result<Job, StoreError> {
        let found = self
            .read(READING)
            .job(id)
            .await?
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
        let mut reading = self.read(READING);
        let mut query = of_digest(digest, states);
        query.push(" ORDER BY job.id DESC LIMIT 1");
        Ok(reading.jobs_of(query).await?.into_iter().next())
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
        let mut reading = self.read(READING);
        let mut query = of_digest(digest, states);
        query.push(" AND NOT {gone job} ORDER BY job.id DESC LIMIT 1");
        Ok(reading.jobs_of(query).await?.into_iter().next())
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
        let mut reading = self.read(READING);
        let mut query = sql(SELECT_JOB);
        query.push(
            "WHERE job.id = (SELECT MAX(reader.id) FROM dataset \
             JOIN job_need ON job_need.needs = dataset.job \
             JOIN job AS reader ON reader.id = job_need.job \
             WHERE reader.deleted_at IS NULL AND reader.kind = ",
        );
        query.push_bind(kind.to_owned()).push(" AND dataset.id = ").push_bind(dataset).push(")");
        Ok(reading.jobs_of(query).await?.into_iter().next())
    }

    /// Those of the jobs with these ids that exist, sorted by id.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn jobs_by_id(&self, ids: &[JobId]) -> Result<Vec<Job>, StoreError> {
        let mut reading = self.read(READING);
        let mut query = sql(SELECT_JOB);
        query.push("WHERE job.id IN ").push_ids(&ids).push(" ORDER BY job.id");
        reading.jobs_of(query).await
    }

    /// The specs of the jobs with these ids.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn specs(&self, ids: &[JobId]) -> Result<Vec<(JobId, Value)>, StoreError> {
        let rows = sql("SELECT id, spec FROM job WHERE id IN {ids $1} ORDER BY id")
            .bind(json(&ids))
            .rows(&mut self.read(READING))
            .await?;
        rows.iter().map(|row| Ok((row.get("id")?, row.get("spec")?))).collect()
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
        let rows = sql("SELECT digest, spec FROM job WHERE id IN (SELECT MAX(id) FROM job \
             WHERE digest IN {texts $1} GROUP BY digest)")
        .bind(json(&digests))
        .rows(&mut self.read(READING))
        .await?;
        rows.iter().map(|row| Ok((row.get("digest")?, row.get("spec")?))).collect()
    }

    /// Pairs of a job of `jobs` and a job that must succeed before it can start, sorted by both
    /// ids.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn needs(&self, jobs: &[JobId]) -> Result<Vec<(JobId, JobId)>, StoreError> {
        sql("SELECT job, needs FROM job_need WHERE job IN {ids $1} ORDER BY job, needs")
            .bind(json(&jobs))
            .all(&mut self.read("reading the needs of jobs"))
            .await
    }

    /// Pairs of a job of `jobs` and a job whose results it uses, sorted by both ids: the jobs that
    /// it needs, and those that left the checkpoints that it named.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn sources(&self, jobs: &[JobId]) -> Result<Vec<(JobId, JobId)>, StoreError> {
        let mut query = sql("SELECT job, needs FROM job_need WHERE job IN {ids $1} UNION ");
        query.push(SELECT_READ).push("AND input.job IN {ids $1} ORDER BY job, needs");
        query.bind(json(&jobs)).all(&mut self.read("reading the sources of jobs")).await
    }

    /// Pairs of a job and a job of `jobs` whose results it uses, like those of [`Store::sources`].
    /// The newest user comes first, and there are at most [`USERS`].
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn users(&self, jobs: &[JobId]) -> Result<Vec<(JobId, JobId)>, StoreError> {
        let mut query = sql("SELECT job, needs FROM job_need WHERE needs IN {ids $1} UNION ");
        query.push(SELECT_READ);
        query.push("AND source.id IN {ids $1} ORDER BY job DESC, needs LIMIT $2");
        query.bind(json(&jobs)).bind(USERS).all(&mut self.read("reading the users of jobs")).await
    }
}

const READING: &str = "reading jobs";

/// Pairs that [`Store::users`] gives.
const USERS: i64 = 1000;

/// Pairs of a job and the job with a result that it reads by digest without needing that job, as a
/// checkpoint that existed when it was submitted. Of several jobs with the digest it is the newest
/// before the reader. Followed by another condition.
const SELECT_READ: &str = "SELECT input.job, source.id AS needs FROM job_input AS input \
     JOIN job AS source ON source.digest = input.digest AND source.id < input.job \
     WHERE NOT EXISTS (SELECT 1 FROM job_need JOIN job AS needed ON needed.id = job_need.needs \
     WHERE job_need.job = input.job AND needed.digest = input.digest) \
     AND NOT EXISTS (SELECT 1 FROM job AS newer WHERE newer.digest = source.digest \
     AND newer.id > source.id AND newer.id < input.job) ";

/// Followed by a condition.
pub(crate) const SELECT_JOB: &str = "SELECT job.*, asked.cpus, asked.gpus, asked.memory_mb, asked.tags, {tags job_tag job job.id} \
     AS own_tags, dataset.id AS dataset, run.id AS run FROM job LEFT JOIN resources AS asked ON \
     asked.id = job.resources LEFT JOIN dataset ON dataset.job = job.id AND dataset.deleted_at IS \
     NULL LEFT JOIN run ON run.job = job.id AND run.deleted_at IS NULL ";

impl Reading<'_> {
    pub async fn job(&mut self, id: JobId) -> Result<Option<Job>, StoreError> {
        let mut query = sql(SELECT_JOB);
        query.push("WHERE job.id = ").push_bind(id);
        Ok(self.jobs_of(query).await?.into_iter().next())
    }

    async fn jobs_of(&mut self, query: Query) -> Result<Vec<Job>, StoreError> {
        let mut jobs: Vec<Job> = query.all(self).await?;
        self.add_progress(&mut jobs).await?;
        Ok(jobs)
    }

    async fn add_progress(&mut self, jobs: &mut [Job]) -> Result<(), StoreError> {
        let ids: Vec<JobId> = jobs.iter().map(|job| job.id).collect();
        let mut by_job = self.progress(&ids).await?;
        for job in jobs {
            if let Some(found) = by_job.remove(&job.id) {
                job.progress =
                    JobProgress { unit: std::mem::take(&mut job.progress.unit), ..found };
            }
        }
        Ok(())
    }

    /// The progress of jobs, without their units.
    pub(super) async fn progress(
        &mut self,
        ids: &[JobId],
    ) -> Result<HashMap<JobId, JobProgress>, StoreError> {
        if ids.is_empty() {
            return Ok(HashMap::new());
        }
        let rows =
            sql("SELECT job AS id, CAST(SUM(CASE WHEN state = 'succeeded' THEN total ELSE done \
                 END) AS BIGINT) AS done, CAST(SUM(total) AS BIGINT) AS total, SUM(CASE WHEN \
                 state = 'running' THEN rate END) AS rate, MAX(CASE WHEN state = 'running' THEN \
                 message END) AS message FROM task WHERE job IN {ids $1} GROUP BY job UNION ALL \
                 SELECT member.pipeline AS id, COUNT(*) FILTER \
                 (WHERE job.state = 'succeeded') AS done, COUNT(*) AS total, NULL AS rate, NULL \
                 AS message FROM pipeline_member AS member JOIN job ON job.id = member.job \
                 WHERE member.pipeline IN {ids $1} GROUP BY member.pipeline")
            .bind(json(&ids))
            .rows(self)
            .await?;
        rows.iter().map(|row| Ok((row.get("id")?, JobProgress::from_row(row)?))).collect()
    }
}

impl Transaction {
    pub async fn job_state(&mut self, job: JobId) -> Result<Option<JobState>, StoreError> {
        let state: Option<JobState> =
            sql("SELECT state FROM job WHERE id = $1").bind(job).optional(self).await?;
        Ok(state)
    }

    /// The jobs that wait for `job`.
    pub async fn waiting_dependents(&mut self, job: JobId) -> Result<Vec<JobId>, StoreError> {
        sql("SELECT job.id FROM job_need JOIN job ON job.id = job_need.job \
             WHERE job_need.needs = $1 AND job.state = 'waiting' ORDER BY job.id")
        .bind(job)
        .all(self)
        .await
    }

    /// The states of the jobs that `job` needs.
    pub async fn states_of_needs(&mut self, job: JobId) -> Result<Vec<JobState>, StoreError> {
        let states: Vec<JobState> = sql(
            "SELECT needed.state FROM job_need JOIN job AS needed ON needed.id = job_need.needs \
             WHERE job_need.job = $1",
        )
        .bind(job)
        .all(self)
        .await?;
        Ok(states)
    }

    pub async fn queue_job(&mut self, job: JobId) -> Result<(), StoreError> {
        sql("UPDATE job SET state = 'queued' WHERE id = $1").bind(job).run(self).await
    }

    /// Marks a job as running. Returns whether it was still queued.
    pub async fn start_job(&mut self, job: JobId) -> Result<bool, StoreError> {
        let started = sql("UPDATE job SET state = 'running', started_at = {now} WHERE id = $1 \
                 AND state = 'queued'")
        .bind(job)
        .changed(self)
        .await?;
        Ok(started > 0)
    }

    pub async fn end_job(
        &mut self,
        job: JobId,
        state: JobState,
        error: Option<&str>,
    ) -> Result<(), StoreError> {
        sql("UPDATE job SET state = $1, error = $2, finished_at = {now} WHERE id = $3")
            .bind(state)
            .bind(error)
            .bind(job)
            .run(self)
            .await
    }

    pub async fn request_cancellation(&mut self, job: JobId) -> Result<(), StoreError> {
        sql("UPDATE job SET cancel_requested = TRUE WHERE id = $1").bind(job).run(self).await
    }
}

fn of_digest(digest: Digest, states: &[JobState]) -> Query {
    let mut query = sql(SELECT_JOB);
    query.push("WHERE job.digest = ").push_bind(digest.to_string());
    let states: Vec<&str> = states.iter().map(|state| state.as_str()).collect();
    query.push(" AND job.state IN ").push_texts(&states);
    query
}

// Everything but the unit.
from_row!(JobProgress {
    done, total, message,
    ..row =>
    unit: String::new(),
    rate_per_second: row.get("rate")?,
});

impl FromRow for Job {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let given_name: Option<String> = row.get("given_name")?;
        Ok(Self {
            id: row.get("id")?,
            kind: row.get("kind")?,
            name: given_name.clone().map_or_else(|| row.get("name"), Ok)?,
            given_name,
            note: row.get("note")?,
            tags: tags(row, "own_tags")?,
            spec: row.get("spec")?,
            digest: row.get("digest")?,
            state: row.get("state")?,
            error: row.get("error")?,
            execution: Execution::from_row(row)?,
            cancel_requested: row.get("cancel_requested")?,
            progress: JobProgress { unit: row.get("unit")?, ..JobProgress::default() },
            dataset: row.get("dataset")?,
            run: row.get("run")?,
            created_at: row.get("created_at")?,
            started_at: row.get("started_at")?,
            finished_at: row.get("finished_at")?,
            deletion: deletion(row)?,
        })
    }
}
