use serde_json::Value;
use sqlx::types::Json;
use sqlx::{FromRow, Row};

use super::rows::{json, number, state};
use super::{Database, DbRow};
use crate::{JobId, Progress, ResultTally, Task, TaskOverview, TaskPage};

/// The columns of [`TaskOverview`].
macro_rules! select_overview {
    ($($rest:expr),+ $(,)?) => {
        concat!(
            "SELECT id, job, label, state, attempt, worker, done, total, rate, message, error \
             FROM task ",
            $($rest),+
        )
    };
}

impl Database {
    /// A page of the tasks of a job, in the order in which they run.
    pub async fn task_page(&self, job: JobId, page: TaskPage) -> Result<Vec<Task>, sqlx::Error> {
        let query = match page.after {
            None => {
                sqlx::query_as("SELECT * FROM task WHERE job = $1 ORDER BY stage, ordinal LIMIT $2")
                    .bind(job)
                    .bind(page.limit())
            }
            Some(after) => sqlx::query_as(
                "SELECT * FROM task WHERE job = $1 AND (stage, ordinal) > \
                 (SELECT stage, ordinal FROM task WHERE job = $1 AND id = $2) \
                 ORDER BY stage, ordinal LIMIT $3",
            )
            .bind(job)
            .bind(after)
            .bind(page.limit()),
        };
        query.fetch_all(&self.reader).await
    }

    /// The first tasks of a job, in the order in which they run.
    pub async fn first_tasks(
        &self,
        job: JobId,
        limit: u32,
    ) -> Result<Vec<TaskOverview>, sqlx::Error> {
        sqlx::query_as(select_overview!("WHERE job = $1 ORDER BY stage, ordinal LIMIT $2"))
            .bind(job)
            .bind(i64::from(limit))
            .fetch_all(&self.reader)
            .await
    }

    pub async fn count_tasks(&self, job: JobId) -> Result<u64, sqlx::Error> {
        let tasks: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM task WHERE job = $1")
            .bind(job)
            .fetch_one(&self.reader)
            .await?;
        Ok(tasks.unsigned_abs())
    }

    /// The tasks of a stage of `jobs`, by job, in the order in which they run.
    pub async fn tasks_of_stage(
        &self,
        jobs: &[JobId],
        stage: u32,
    ) -> Result<Vec<TaskOverview>, sqlx::Error> {
        sqlx::query_as(select_overview!(
            "WHERE job IN ",
            listed_ids!("$1"),
            " AND stage = $2 ORDER BY job, ordinal"
        ))
        .bind(Json(jobs))
        .bind(i64::from(stage))
        .fetch_all(&self.reader)
        .await
    }

    pub async fn sole_results(&self, jobs: &[JobId]) -> Result<Vec<(JobId, Value)>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT job, result FROM task AS last \
             WHERE job IN ",
            listed_ids!("$1"),
            " AND result IS NOT NULL \
             AND NOT EXISTS (SELECT 1 FROM task AS other WHERE other.job = last.job \
                 AND other.stage >= last.stage \
                 AND (other.stage, other.ordinal) <> (last.stage, last.ordinal))"
        ))
        .bind(Json(jobs))
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("job")?, json(row, "result")?))).collect()
    }

    pub async fn result_tallies(
        &self,
        jobs: &[JobId],
        field: &str,
    ) -> Result<Vec<ResultTally>, sqlx::Error> {
        let rows: Vec<(JobId, Option<String>, i64)> = sqlx::query_as(concat!(
            "SELECT job, ",
            field!("result", "$1"),
            " AS found, COUNT(*) FROM task \
             WHERE job IN ",
            listed_ids!("$2"),
            " GROUP BY job, found"
        ))
        .bind(field)
        .bind(Json(jobs))
        .fetch_all(&self.reader)
        .await?;
        let tally = |(job, value, tasks): (JobId, Option<String>, i64)| ResultTally {
            job,
            value,
            tasks: tasks.unsigned_abs(),
        };
        Ok(rows.into_iter().map(tally).collect())
    }

    /// Labels and results of tasks, in the order in which the tasks run.
    pub async fn results_unlike(
        &self,
        job: JobId,
        field: &str,
        value: &str,
        limit: u32,
    ) -> Result<Vec<(String, Value)>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT label, result FROM task WHERE job = $1 AND ",
            field!("result", "$2"),
            " <> $3 \
             ORDER BY stage, ordinal LIMIT $4"
        ))
        .bind(job)
        .bind(field)
        .bind(value)
        .bind(i64::from(limit))
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("label")?, json(row, "result")?))).collect()
    }
}

impl FromRow<'_, DbRow> for TaskOverview {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            label: row.try_get("label")?,
            state: state(row)?,
            attempt: number(row, "attempt")?,
            worker: row.try_get("worker")?,
            progress: Progress {
                done: number(row, "done")?,
                rate_per_second: row.try_get("rate")?,
                message: row.try_get("message")?,
            },
            total: number(row, "total")?,
            error: row.try_get("error")?,
        })
    }
}
