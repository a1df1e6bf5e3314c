use std::collections::HashMap;

use serde_json::Value;
use spec::Digest;
use sqlx::types::{Json, Text};
use sqlx::{FromRow, QueryBuilder, Row};
use wire::JobState;

use super::rows::{
    deletion, digest, json, moment, number, optional_number, resources, state, tags,
};
use super::{Database, Db, DbRow, LISTED_IDS, LISTED_TEXTS, Transaction};
use crate::{DatasetId, Job, JobId, JobProgress};

/// Followed by a condition.
pub(crate) const SELECT_JOB: &str = concat!(
    "SELECT job.*, asked.cpus, asked.gpus, asked.memory_mb, asked.tags, ",
    tags_of!("job_tag", "job", "job.id"),
    " AS own_tags, dataset.id AS dataset, run.id AS run FROM job \
     LEFT JOIN resources AS asked ON asked.id = job.resources \
     LEFT JOIN dataset ON dataset.job = job.id AND dataset.deleted_at IS NULL \
     LEFT JOIN run ON run.job = job.id AND run.deleted_at IS NULL "
);

impl Database {
    pub async fn job(&self, id: JobId) -> Result<Option<Job>, sqlx::Error> {
        let mut query = QueryBuilder::new(SELECT_JOB);
        query.push("WHERE job.id = ").push_bind(id);
        Ok(self.jobs_of(query).await?.into_iter().next())
    }

    pub async fn job_by_digest(
        &self,
        digest: Digest,
        states: &[JobState],
    ) -> Result<Option<Job>, sqlx::Error> {
        let mut query = of_digest(digest, states);
        query.push(" ORDER BY job.id DESC LIMIT 1");
        Ok(self.jobs_of(query).await?.into_iter().next())
    }

    pub async fn usable_job_by_digest(
        &self,
        digest: Digest,
        states: &[JobState],
    ) -> Result<Option<Job>, sqlx::Error> {
        let mut query = of_digest(digest, states);
        query.push(concat!(" AND NOT ", is_gone!("job"), " ORDER BY job.id DESC LIMIT 1"));
        Ok(self.jobs_of(query).await?.into_iter().next())
    }

    pub async fn newest_reader(
        &self,
        dataset: DatasetId,
        kind: &str,
    ) -> Result<Option<Job>, sqlx::Error> {
        let mut query = QueryBuilder::new(SELECT_JOB);
        query.push(
            "WHERE job.id = (SELECT MAX(reader.id) FROM dataset \
             JOIN job_need ON job_need.needs = dataset.job \
             JOIN job AS reader ON reader.id = job_need.job \
             WHERE reader.deleted_at IS NULL AND reader.kind = ",
        );
        query.push_bind(kind.to_owned()).push(" AND dataset.id = ").push_bind(dataset).push(")");
        Ok(self.jobs_of(query).await?.into_iter().next())
    }

    /// Sorted by id.
    pub async fn jobs_by_id(&self, ids: &[JobId]) -> Result<Vec<Job>, sqlx::Error> {
        let mut query = QueryBuilder::new(SELECT_JOB);
        query.push("WHERE job.id IN ").push(LISTED_IDS.0).push_bind(Json(ids.to_vec()));
        query.push(LISTED_IDS.1).push(" ORDER BY job.id");
        self.jobs_of(query).await
    }

    pub async fn specs(&self, ids: &[JobId]) -> Result<Vec<(JobId, Value)>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT id, spec FROM job WHERE id IN ",
            listed_ids!("$1"),
            " ORDER BY id"
        ))
        .bind(Json(ids))
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("id")?, json(row, "spec")?))).collect()
    }

    pub async fn newest_specs(
        &self,
        digests: &[Digest],
    ) -> Result<Vec<(Digest, Value)>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT digest, spec FROM job WHERE id IN (SELECT MAX(id) FROM job \
             WHERE digest IN ",
            listed_texts!("$1"),
            " GROUP BY digest)"
        ))
        .bind(Json(digests))
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(|row| Ok((digest(row, "digest")?, json(row, "spec")?))).collect()
    }

    /// Pairs of a job and a job that it needs, sorted by both ids.
    pub async fn needs(&self, jobs: &[JobId]) -> Result<Vec<(JobId, JobId)>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT job, needs FROM job_need WHERE job IN ",
            listed_ids!("$1"),
            " \
             ORDER BY job, needs"
        ))
        .bind(Json(jobs))
        .fetch_all(&self.reader)
        .await
    }

    async fn jobs_of(&self, mut query: QueryBuilder<Db>) -> Result<Vec<Job>, sqlx::Error> {
        let mut jobs: Vec<Job> = query.build_query_as().fetch_all(&self.reader).await?;
        self.add_progress(&mut jobs).await?;
        Ok(jobs)
    }

    async fn add_progress(&self, jobs: &mut [Job]) -> Result<(), sqlx::Error> {
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
        &self,
        ids: &[JobId],
    ) -> Result<HashMap<JobId, JobProgress>, sqlx::Error> {
        if ids.is_empty() {
            return Ok(HashMap::new());
        }
        let rows = sqlx::query(
            concat!("SELECT job AS id, CAST(SUM(CASE WHEN state = 'succeeded' THEN total ELSE done END) AS BIGINT) AS done, \
             CAST(SUM(total) AS BIGINT) AS total, SUM(CASE WHEN state = 'running' THEN rate END) AS rate, \
             MAX(CASE WHEN state = 'running' THEN message END) AS message \
             FROM task WHERE job IN ", listed_ids!("$1"), " GROUP BY job UNION ALL \
             SELECT member.pipeline AS id, COUNT(*) FILTER (WHERE job.state = 'succeeded') AS done, \
             COUNT(*) AS total, NULL AS rate, NULL AS message \
             FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline IN ", listed_ids!("$1"), " GROUP BY member.pipeline"),
        )
        .bind(Json(ids))
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("id")?, JobProgress::from_row(row)?))).collect()
    }
}

impl Transaction {
    pub async fn job_state(&mut self, job: JobId) -> Result<Option<JobState>, sqlx::Error> {
        let state: Option<Text<JobState>> =
            sqlx::query_scalar("SELECT state FROM job WHERE id = $1")
                .bind(job)
                .fetch_optional(self.connection())
                .await?;
        Ok(state.map(|Text(state)| state))
    }

    /// The jobs that wait for `job`.
    pub async fn waiting_dependents(&mut self, job: JobId) -> Result<Vec<JobId>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT job.id FROM job_need JOIN job ON job.id = job_need.job \
             WHERE job_need.needs = $1 AND job.state = 'waiting' ORDER BY job.id",
        )
        .bind(job)
        .fetch_all(self.connection())
        .await
    }

    /// The states of the jobs that `job` needs.
    pub async fn states_of_needs(&mut self, job: JobId) -> Result<Vec<JobState>, sqlx::Error> {
        let states: Vec<Text<JobState>> = sqlx::query_scalar(
            "SELECT needed.state FROM job_need JOIN job AS needed ON needed.id = job_need.needs \
             WHERE job_need.job = $1",
        )
        .bind(job)
        .fetch_all(self.connection())
        .await?;
        Ok(states.into_iter().map(|Text(state)| state).collect())
    }

    pub async fn queue_job(&mut self, job: JobId) -> Result<(), sqlx::Error> {
        let statement = sqlx::query("UPDATE job SET state = 'queued' WHERE id = $1").bind(job);
        self.execute(statement).await
    }

    /// Marks a job as running. Returns whether it was still queued.
    pub async fn start_job(&mut self, job: JobId) -> Result<bool, sqlx::Error> {
        let started = sqlx::query(concat!(
            "UPDATE job SET state = 'running', started_at = ",
            now!(),
            " WHERE id = $1 AND state = 'queued'"
        ))
        .bind(job)
        .execute(self.connection())
        .await?;
        Ok(started.rows_affected() > 0)
    }

    pub async fn end_job(
        &mut self,
        job: JobId,
        state: JobState,
        error: Option<&str>,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE job SET state = $1, error = $2, finished_at = ",
            now!(),
            " WHERE id = $3"
        ))
        .bind(state.as_str())
        .bind(error)
        .bind(job);
        self.execute(statement).await
    }

    pub async fn request_cancellation(&mut self, job: JobId) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query("UPDATE job SET cancel_requested = TRUE WHERE id = $1").bind(job);
        self.execute(statement).await
    }
}

fn of_digest(digest: Digest, states: &[JobState]) -> QueryBuilder<Db> {
    let mut query = QueryBuilder::new(SELECT_JOB);
    query.push("WHERE job.digest = ").push_bind(digest.to_string());
    let states: Vec<&str> = states.iter().map(|state| state.as_str()).collect();
    query.push(" AND job.state IN ").push(LISTED_TEXTS.0).push_bind(Json(states));
    query.push(LISTED_TEXTS.1);
    query
}

/// Everything but the unit.
impl FromRow<'_, DbRow> for JobProgress {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            done: number(row, "done")?,
            total: number(row, "total")?,
            unit: String::new(),
            rate_per_second: row.try_get("rate")?,
            message: row.try_get("message")?,
        })
    }
}

impl FromRow<'_, DbRow> for Job {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let given_name: Option<String> = row.try_get("given_name")?;
        Ok(Self {
            id: row.try_get("id")?,
            kind: row.try_get("kind")?,
            name: given_name.clone().map_or_else(|| row.try_get("name"), Ok)?,
            given_name,
            note: row.try_get("note")?,
            tags: tags(row, "own_tags")?,
            spec: json(row, "spec")?,
            digest: digest(row, "digest")?,
            state: state(row)?,
            error: row.try_get("error")?,
            priority: number(row, "priority")?,
            max_attempts: number(row, "max_attempts")?,
            time_limit_s: optional_number(row, "time_limit_s")?,
            resources: resources(row)?,
            not_before: moment(row, "not_before")?,
            cancel_requested: row.try_get("cancel_requested")?,
            progress: JobProgress { unit: row.try_get("unit")?, ..JobProgress::default() },
            dataset: row.try_get("dataset")?,
            run: row.try_get("run")?,
            created_at: row.try_get("created_at")?,
            started_at: row.try_get("started_at")?,
            finished_at: row.try_get("finished_at")?,
            deletion: deletion(row)?,
        })
    }
}
