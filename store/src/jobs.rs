//! Jobs, as they are looked up.

use std::collections::HashMap;

use serde_json::Value;
use spec::Digest;
use sqlx::sqlite::SqliteRow;
use sqlx::types::Text;
use sqlx::{FromRow, QueryBuilder, Row, Sqlite};

use crate::{DatasetId, JobId, JobState, RunId, Store, StoreError, Timestamp};

#[derive(Clone, Debug)]
pub struct Job {
    pub id: JobId,
    /// Opaque to the store.
    pub kind: String,
    pub name: String,
    /// Resolved: every default filled in, every reference a digest.
    pub spec: Value,
    pub digest: Digest,
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    pub priority: i32,
    pub max_attempts: u32,
    pub cancel_requested: bool,
    pub progress: JobProgress,
    /// What it fills, if it fills one.
    pub dataset: Option<DatasetId>,
    /// Its record, if it leaves one.
    pub run: Option<RunId>,
    pub created_at: Timestamp,
    pub started_at: Option<Timestamp>,
    pub finished_at: Option<Timestamp>,
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
    pub const MAX_LIMIT: u32 = 500;

    pub(crate) fn before(self) -> i64 {
        self.before.unwrap_or(i64::MAX)
    }

    pub(crate) fn limit(self) -> u32 {
        self.limit.min(Self::MAX_LIMIT)
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

const SELECT_JOB: &str = "SELECT job.*, dataset.id AS dataset, run.id AS run FROM job \
    LEFT JOIN dataset ON dataset.job = job.id LEFT JOIN run ON run.job = job.id ";

impl Store {
    /// # Errors
    /// When there is no such job.
    pub async fn job(&self, id: JobId) -> Result<Job, StoreError> {
        let mut query = QueryBuilder::new(SELECT_JOB);
        query.push("WHERE job.id = ").push_bind(id);
        let jobs = self.jobs_of(query).await?;
        jobs.into_iter().next().ok_or_else(|| StoreError::not_found("job", id.to_string()))
    }

    /// Newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn jobs(&self, filter: JobFilter<'_>, page: Page) -> Result<Vec<Job>, StoreError> {
        let mut query = QueryBuilder::new(SELECT_JOB);
        query.push("WHERE job.id < ").push_bind(page.before());
        if let Some(kind) = filter.kind {
            query.push(" AND job.kind = ").push_bind(kind.to_owned());
        }
        if let Some(state) = filter.state {
            query.push(" AND job.state = ").push_bind(state.as_str());
        }
        query.push(" ORDER BY job.id DESC LIMIT ").push_bind(page.limit());
        self.jobs_of(query).await
    }

    /// The newest job of a digest in one of `states`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn job_by_digest(
        &self,
        digest: Digest,
        states: &[JobState],
    ) -> Result<Option<Job>, StoreError> {
        let mut query = QueryBuilder::new(SELECT_JOB);
        query.push("WHERE job.digest = ").push_bind(digest.to_string());
        query.push(" AND job.state IN (");
        let mut list = query.separated(", ");
        for state in states {
            list.push_bind(state.as_str());
        }
        query.push(") ORDER BY job.id DESC LIMIT 1");
        Ok(self.jobs_of(query).await?.into_iter().next())
    }

    /// The newest job of `kind` that needs the job of this very dataset, not of another with its
    /// digest.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn newest_reader(
        &self,
        dataset: DatasetId,
        kind: &str,
    ) -> Result<Option<Job>, StoreError> {
        let mut query = QueryBuilder::new(SELECT_JOB);
        query.push(
            "WHERE job.id = (SELECT MAX(reader.id) FROM dataset \
             JOIN job_need ON job_need.needs = dataset.job \
             JOIN job AS reader ON reader.id = job_need.job WHERE reader.kind = ",
        );
        query.push_bind(kind.to_owned()).push(" AND dataset.id = ").push_bind(dataset).push(")");
        Ok(self.jobs_of(query).await?.into_iter().next())
    }

    /// The jobs that must succeed before `job` can start.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn needs(&self, job: JobId) -> Result<Vec<JobId>, StoreError> {
        sqlx::query_scalar("SELECT needs FROM job_need WHERE job = ? ORDER BY needs")
            .bind(job)
            .fetch_all(self.database().reader())
            .await
            .map_err(StoreError::database("reading a job's needs"))
    }

    async fn jobs_of(&self, mut query: QueryBuilder<Sqlite>) -> Result<Vec<Job>, StoreError> {
        let failed = StoreError::database("reading jobs");
        let mut jobs: Vec<Job> =
            query.build_query_as().fetch_all(self.database().reader()).await.map_err(&failed)?;
        let mut progress = self.progress_of(&jobs).await.map_err(&failed)?;
        for job in &mut jobs {
            if let Some(found) = progress.remove(&job.id) {
                job.progress =
                    JobProgress { unit: std::mem::take(&mut job.progress.unit), ..found };
            }
        }
        Ok(jobs)
    }

    async fn progress_of(&self, jobs: &[Job]) -> Result<HashMap<JobId, JobProgress>, sqlx::Error> {
        if jobs.is_empty() {
            return Ok(HashMap::new());
        }
        let mut query = QueryBuilder::<Sqlite>::new(
            "SELECT job AS id, SUM(CASE WHEN state = 'succeeded' THEN total ELSE done END) AS done, \
             SUM(total) AS total, SUM(CASE WHEN state = 'running' THEN rate END) AS rate, \
             MAX(CASE WHEN state = 'running' THEN message END) AS message \
             FROM task WHERE job IN (",
        );
        push_ids(&mut query, jobs);
        query.push(
            ") GROUP BY job UNION ALL \
             SELECT member.pipeline AS id, SUM(job.state = 'succeeded') AS done, \
             COUNT(*) AS total, NULL AS rate, NULL AS message \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline IN (",
        );
        push_ids(&mut query, jobs);
        query.push(") GROUP BY member.pipeline");
        let rows = query.build().fetch_all(self.database().reader()).await?;
        rows.iter().map(|row| Ok((row.try_get("id")?, progress_from_row(row)?))).collect()
    }
}

fn push_ids(query: &mut QueryBuilder<Sqlite>, jobs: &[Job]) {
    let mut list = query.separated(", ");
    for job in jobs {
        list.push_bind(job.id);
    }
}

fn progress_from_row(row: &SqliteRow) -> Result<JobProgress, sqlx::Error> {
    Ok(JobProgress {
        done: row.try_get("done")?,
        total: row.try_get("total")?,
        unit: String::new(),
        rate_per_second: row.try_get("rate")?,
        message: row.try_get("message")?,
    })
}

impl FromRow<'_, SqliteRow> for Job {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            kind: row.try_get("kind")?,
            name: row.try_get("name")?,
            spec: json(row, "spec")?,
            digest: digest(row, "digest")?,
            state: row.try_get::<Text<_>, _>("state")?.0,
            error: row.try_get("error")?,
            priority: row.try_get("priority")?,
            max_attempts: row.try_get("max_attempts")?,
            cancel_requested: row.try_get("cancel_requested")?,
            progress: JobProgress { unit: row.try_get("unit")?, ..JobProgress::default() },
            dataset: row.try_get("dataset")?,
            run: row.try_get("run")?,
            created_at: row.try_get("created_at")?,
            started_at: row.try_get("started_at")?,
            finished_at: row.try_get("finished_at")?,
        })
    }
}

pub(crate) fn digest(row: &SqliteRow, column: &str) -> Result<Digest, sqlx::Error> {
    let text: &str = row.try_get(column)?;
    text.parse().map_err(|error: spec::ParseDigestError| undecodable(column, error.into()))
}

pub(crate) fn json(row: &SqliteRow, column: &str) -> Result<Value, sqlx::Error> {
    let text: &str = row.try_get(column)?;
    serde_json::from_str(text).map_err(|error| undecodable(column, error.into()))
}

fn undecodable(column: &str, source: sqlx::error::BoxDynError) -> sqlx::Error {
    sqlx::Error::ColumnDecode { index: column.to_owned(), source }
}
