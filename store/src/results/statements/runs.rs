use sqlx::types::Json;
use sqlx::{FromRow, Row};

use super::rows::{deletion, digest, json, state, tags};
use super::{Database, DbRow, Transaction};
use crate::{JobId, Run, RunId};

macro_rules! select_run {
    ($($rest:expr),+ $(,)?) => {
        concat!(
            "SELECT run.id, run.job, run.created_at, run.note, run.deleted_at, run.purge_at, run.purged_at, \
             run.deletion_reason, job.kind, job.digest, job.spec, \
             COALESCE(run.given_name, job.given_name, job.name) AS name, \
             job.state, job.error, job.started_at, job.finished_at, ",
            tags_of!("run_tag", "run", "run.id"),
            " AS own_tags, ",
            tags_of!("job_tag", "job", "run.job"),
            " AS job_tags FROM run JOIN job ON job.id = run.job ",
            $($rest),+
        )
    };
}

impl Database {
    pub async fn run(&self, id: RunId) -> Result<Option<Run>, sqlx::Error> {
        sqlx::query_as(select_run!("WHERE run.id = $1")).bind(id).fetch_optional(&self.reader).await
    }

    pub async fn runs_by_id(&self, ids: &[RunId]) -> Result<Vec<Run>, sqlx::Error> {
        sqlx::query_as(select_run!("WHERE run.id IN ", listed_ids!("$1")))
            .bind(Json(ids))
            .fetch_all(&self.reader)
            .await
    }

    pub async fn run_of_job(&self, job: JobId) -> Result<Option<Run>, sqlx::Error> {
        sqlx::query_as(select_run!("WHERE run.job = $1"))
            .bind(job)
            .fetch_optional(&self.reader)
            .await
    }
}

impl Transaction {
    pub async fn insert_run(&mut self, job: JobId) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query(concat!("INSERT INTO run (job, created_at) VALUES ($1, ", now!(), ")"))
                .bind(job);
        self.execute(statement).await
    }

    pub async fn run_id(&mut self, job: JobId) -> Result<Option<RunId>, sqlx::Error> {
        sqlx::query_scalar("SELECT id FROM run WHERE job = $1")
            .bind(job)
            .fetch_optional(self.connection())
            .await
    }
}

impl FromRow<'_, DbRow> for Run {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            kind: row.try_get("kind")?,
            name: row.try_get("name")?,
            note: row.try_get("note")?,
            tags: tags(row, "own_tags")?,
            job_tags: tags(row, "job_tags")?,
            digest: digest(row, "digest")?,
            spec: json(row, "spec")?,
            state: state(row)?,
            error: row.try_get("error")?,
            created_at: row.try_get("created_at")?,
            started_at: row.try_get("started_at")?,
            finished_at: row.try_get("finished_at")?,
            deletion: deletion(row)?,
        })
    }
}
