//! Runs: the records of jobs whose output is one. Each has it from its submission on.

use serde_json::Value;
use spec::Digest;
use sqlx::sqlite::SqliteRow;
use sqlx::types::Text;
use sqlx::{FromRow, Row};

use crate::{JobId, JobState, Page, RunId, Store, StoreError, Timestamp, jobs};

#[derive(Clone, Debug)]
pub struct Run {
    pub id: RunId,
    pub job: JobId,
    /// The job's.
    pub kind: String,
    pub name: String,
    pub digest: Digest,
    pub spec: Value,
    pub state: JobState,
    pub error: Option<String>,
    pub created_at: Timestamp,
    pub started_at: Option<Timestamp>,
    pub finished_at: Option<Timestamp>,
}

macro_rules! select_run {
    ($rest:literal) => {
        concat!(
            "SELECT run.id, run.job, run.created_at, job.kind, job.name, job.digest, job.spec, \
             job.state, job.error, job.started_at, job.finished_at \
             FROM run JOIN job ON job.id = run.job ",
            $rest
        )
    };
}

impl Store {
    /// # Errors
    /// When there is no such run.
    pub async fn run(&self, id: RunId) -> Result<Run, StoreError> {
        sqlx::query_as(select_run!("WHERE run.id = ?"))
            .bind(id)
            .fetch_optional(self.database().reader())
            .await
            .map_err(StoreError::database("reading a run"))?
            .ok_or_else(|| StoreError::not_found("run", id.to_string()))
    }

    /// Newest first; all kinds without a `kind`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn runs(&self, kind: Option<&str>, page: Page) -> Result<Vec<Run>, StoreError> {
        sqlx::query_as(select_run!(
            "WHERE run.id < ?1 AND (?2 IS NULL OR job.kind = ?2) ORDER BY run.id DESC LIMIT ?3"
        ))
        .bind(page.before())
        .bind(kind)
        .bind(page.limit())
        .fetch_all(self.database().reader())
        .await
        .map_err(StoreError::database("reading runs"))
    }

    /// The record of a job.
    ///
    /// # Errors
    /// When the job has none.
    pub async fn run_of_job(&self, job: JobId) -> Result<Run, StoreError> {
        sqlx::query_as(select_run!("WHERE run.job = ?"))
            .bind(job)
            .fetch_optional(self.database().reader())
            .await
            .map_err(StoreError::database("reading a run"))?
            .ok_or_else(|| StoreError::not_found("run of job", job.to_string()))
    }
}

impl FromRow<'_, SqliteRow> for Run {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            kind: row.try_get("kind")?,
            name: row.try_get("name")?,
            digest: jobs::digest(row, "digest")?,
            spec: jobs::json(row, "spec")?,
            state: row.try_get::<Text<_>, _>("state")?.0,
            error: row.try_get("error")?,
            created_at: row.try_get("created_at")?,
            started_at: row.try_get("started_at")?,
            finished_at: row.try_get("finished_at")?,
        })
    }
}
