use std::collections::BTreeSet;

use sqlx::types::{Json, Text};
use sqlx::{FromRow, Row};
use wire::JobState;

use super::rows::state;
use super::{Database, DbRow, Transaction};
use crate::queue::pipelines::MemberRow;
use crate::queue::rules::cancellation::Candidate;
use crate::{JobId, JobProgress, Member};

impl Database {
    /// Sorted by pipeline, then in the order of submission.
    pub async fn members(&self, pipelines: &[JobId]) -> Result<Vec<Member>, sqlx::Error> {
        let mut members: Vec<Member> = sqlx::query_as(concat!(
            "SELECT member.pipeline, member.name, member.reused, member.job, \
             job.kind, job.state, job.error, job.unit \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline IN ",
            listed_ids!("$1"),
            " \
             ORDER BY member.pipeline, member.ordinal"
        ))
        .bind(Json(pipelines))
        .fetch_all(&self.reader)
        .await?;
        let jobs: BTreeSet<JobId> = members.iter().map(|member| member.job).collect();
        let progress = self.progress(&jobs.into_iter().collect::<Vec<_>>()).await?;
        for member in &mut members {
            if let Some(found) = progress.get(&member.job) {
                let unit = std::mem::take(&mut member.progress.unit);
                member.progress = JobProgress { unit, ..found.clone() };
            }
        }
        Ok(members)
    }
}

impl Transaction {
    pub async fn insert_member(
        &mut self,
        pipeline: JobId,
        ordinal: u32,
        name: &str,
        job: JobId,
        reused: bool,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "INSERT INTO pipeline_member (pipeline, name, ordinal, job, reused) \
             VALUES ($1, $2, $3, $4, $5)",
        )
        .bind(pipeline)
        .bind(name)
        .bind(i64::from(ordinal))
        .bind(job)
        .bind(reused);
        self.execute(statement).await
    }

    pub async fn pipelines_of(&mut self, job: JobId) -> Result<Vec<JobId>, sqlx::Error> {
        sqlx::query_scalar("SELECT DISTINCT pipeline FROM pipeline_member WHERE job = $1")
            .bind(job)
            .fetch_all(self.connection())
            .await
    }

    pub async fn has_members(&mut self, job: JobId) -> Result<bool, sqlx::Error> {
        sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM pipeline_member WHERE pipeline = $1)")
            .bind(job)
            .fetch_one(self.connection())
            .await
    }

    /// The state of a pipeline, and whether its cancellation was requested.
    pub async fn pipeline(&mut self, pipeline: JobId) -> Result<(JobState, bool), sqlx::Error> {
        let (Text(state), cancel_requested) =
            sqlx::query_as("SELECT state, cancel_requested FROM job WHERE id = $1")
                .bind(pipeline)
                .fetch_one(self.connection())
                .await?;
        Ok((state, cancel_requested))
    }

    /// In the order of submission.
    pub async fn member_rows(&mut self, pipeline: JobId) -> Result<Vec<MemberRow>, sqlx::Error> {
        sqlx::query_as(
            "SELECT member.name, job.id AS job, job.state, job.cancel_requested, job.error \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1 ORDER BY member.ordinal",
        )
        .bind(pipeline)
        .fetch_all(self.connection())
        .await
    }

    /// Sets the state of a pipeline. Its times follow from the state.
    pub async fn set_pipeline(
        &mut self,
        pipeline: JobId,
        state: JobState,
        error: Option<&str>,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE job SET state = $1, error = $2, started_at = COALESCE(started_at, ",
            now!(),
            "), finished_at = CASE WHEN $1 = 'running' THEN NULL ELSE ",
            now!(),
            " END WHERE id = $3"
        ))
        .bind(state.as_str())
        .bind(error)
        .bind(pipeline);
        self.execute(statement).await
    }

    /// The members of a pipeline, without the jobs that wait for them.
    pub async fn candidates(&mut self, pipeline: JobId) -> Result<Vec<Candidate>, sqlx::Error> {
        let rows = sqlx::query(
            "SELECT job.id, job.state, job.asked_alone, EXISTS (SELECT 1 \
                 FROM pipeline_member AS other JOIN job AS pipeline ON pipeline.id = other.pipeline \
                 WHERE other.job = job.id AND NOT pipeline.cancel_requested \
                 AND pipeline.state IN ('waiting', 'queued', 'running')) AS is_shared \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1",
        )
        .bind(pipeline)
        .fetch_all(self.connection())
        .await?;
        let candidate = |row: &DbRow| {
            Ok(Candidate {
                job: row.try_get("id")?,
                state: state(row)?,
                asked_alone: row.try_get("asked_alone")?,
                is_shared: row.try_get("is_shared")?,
                needed_by: Vec::new(),
            })
        };
        rows.iter().map(candidate).collect()
    }
}

/// Reads only the unit of the progress.
impl FromRow<'_, DbRow> for Member {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            pipeline: row.try_get("pipeline")?,
            name: row.try_get("name")?,
            job: row.try_get("job")?,
            kind: row.try_get("kind")?,
            state: state(row)?,
            error: row.try_get("error")?,
            progress: JobProgress { unit: row.try_get("unit")?, ..JobProgress::default() },
            reused: row.try_get("reused")?,
        })
    }
}

impl FromRow<'_, DbRow> for MemberRow {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            name: row.try_get("name")?,
            job: row.try_get("job")?,
            state: state(row)?,
            cancel_requested: row.try_get("cancel_requested")?,
            error: row.try_get("error")?,
        })
    }
}
