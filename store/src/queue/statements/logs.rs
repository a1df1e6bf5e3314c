use sqlx::types::Json;
use sqlx::{FromRow, Row};

use super::rows::number;
use super::{Database, DbRow, Transaction, integer};
use crate::{Attempt, Fence, JobId, LogChunk, LogFilter, NewLogChunk, TaskId};

/// Finds the ids of chunks first, because texts are long and should not be sorted. `$1` to `$3` are
/// the filter, `$4` is an id and `$5` the number of chunks.
macro_rules! select_chunks {
    ($comparison:literal, $order:literal) => {
        concat!(
            "SELECT chunk.*, attempt.task, attempt.worker, task.label \
             FROM attempt_log AS chunk JOIN attempt ON attempt.id = chunk.attempt \
             JOIN task ON task.id = attempt.task \
             WHERE chunk.id IN (SELECT chunk.id FROM attempt_log AS chunk \
                 JOIN attempt ON attempt.id = chunk.attempt \
                 WHERE chunk.job IN ",
            listed_ids!("$1"),
            " \
                 AND ($2 IS NULL OR attempt.task IN ",
            listed_ids!("$2"),
            ") \
                 AND ($3 IS NULL OR attempt.id = $3) AND chunk.id ",
            $comparison,
            " $4 ORDER BY chunk.id ",
            $order,
            " LIMIT $5) ORDER BY chunk.id ",
            $order
        )
    };
}

impl Database {
    /// Oldest first.
    pub async fn log_after(
        &self,
        filter: &LogFilter,
        id: i64,
        limit: u32,
    ) -> Result<Vec<LogChunk>, sqlx::Error> {
        sqlx::query_as(select_chunks!(">", "ASC"))
            .bind(Json(&filter.jobs))
            .bind(filter.tasks.as_ref().map(Json))
            .bind(filter.attempt)
            .bind(id)
            .bind(i64::from(limit))
            .fetch_all(&self.reader)
            .await
    }

    /// Newest first.
    pub async fn log_before(
        &self,
        filter: &LogFilter,
        id: Option<i64>,
        limit: u32,
    ) -> Result<Vec<LogChunk>, sqlx::Error> {
        sqlx::query_as(select_chunks!("<", "DESC"))
            .bind(Json(&filter.jobs))
            .bind(filter.tasks.as_ref().map(Json))
            .bind(filter.attempt)
            .bind(id.unwrap_or(i64::MAX))
            .bind(i64::from(limit))
            .fetch_all(&self.reader)
            .await
    }

    /// Sorted by position.
    pub async fn attempt_log(&self, attempt: i64) -> Result<Vec<NewLogChunk>, sqlx::Error> {
        sqlx::query_as(
            "SELECT position, text FROM attempt_log WHERE attempt = $1 ORDER BY position",
        )
        .bind(attempt)
        .fetch_all(&self.reader)
        .await
    }

    pub async fn attempt(&self, id: i64) -> Result<Option<Attempt>, sqlx::Error> {
        sqlx::query_as(
            "SELECT attempt.*, task.label FROM attempt JOIN task ON task.id = attempt.task \
             WHERE attempt.id = $1",
        )
        .bind(id)
        .fetch_optional(&self.reader)
        .await
    }

    pub async fn is_attempt_running(&self, id: i64) -> Result<bool, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM attempt WHERE id = $1 AND ended_at IS NULL)",
        )
        .bind(id)
        .fetch_one(&self.reader)
        .await
    }

    /// Whether any of the tasks has not ended.
    pub async fn are_tasks_open(&self, tasks: &[TaskId]) -> Result<bool, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "SELECT EXISTS (SELECT 1 FROM task WHERE id IN ",
            listed_ids!("$1"),
            " \
             AND state IN ('waiting', 'queued', 'running'))"
        ))
        .bind(Json(tasks))
        .fetch_one(&self.reader)
        .await
    }

    /// Whether any of the jobs has not ended, or has ended while a worker still has one of its
    /// tasks.
    pub async fn are_jobs_open(&self, jobs: &[JobId]) -> Result<bool, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "SELECT EXISTS (SELECT 1 FROM job WHERE id IN ",
            listed_ids!("$1"),
            " \
                 AND state IN ('waiting', 'queued', 'running')) \
             OR EXISTS (SELECT 1 FROM attempt WHERE job IN ",
            listed_ids!("$1"),
            " \
                 AND ended_at IS NULL)"
        ))
        .bind(Json(jobs))
        .fetch_one(&self.reader)
        .await
    }

    pub async fn tasks_labelled(
        &self,
        jobs: &[JobId],
        label: &str,
    ) -> Result<Vec<TaskId>, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "SELECT id FROM task WHERE job IN ",
            listed_ids!("$1"),
            " AND label = $2 \
             ORDER BY id"
        ))
        .bind(Json(jobs))
        .bind(label)
        .fetch_all(&self.reader)
        .await
    }
}

impl Transaction {
    /// The attempts stay.
    pub async fn delete_logs_of_jobs(&mut self, jobs: &[JobId]) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE attempt SET log_bytes = NULL WHERE log_bytes IS NOT NULL AND job IN ",
            listed_ids!("$1")
        ));
        self.execute(statement.bind(Json(jobs))).await?;
        let statement =
            sqlx::query(concat!("DELETE FROM attempt_log WHERE job IN ", listed_ids!("$1")));
        self.execute(statement.bind(Json(jobs))).await
    }

    pub async fn attempt_at(&mut self, fence: Fence) -> Result<Option<i64>, sqlx::Error> {
        sqlx::query_scalar("SELECT id FROM attempt WHERE task = $1 AND epoch = $2")
            .bind(fence.task)
            .bind(fence.epoch)
            .fetch_optional(self.connection())
            .await
    }

    /// Replaces chunks at the same positions. Transactions that insert chunks of one job wait for
    /// each other. Otherwise a reader would see an id before a smaller one.
    pub async fn insert_log(
        &mut self,
        job: JobId,
        attempt: i64,
        chunks: &[NewLogChunk],
    ) -> Result<(), sqlx::Error> {
        self.wait_for_turn(job).await?;
        for chunk in chunks {
            let statement = sqlx::query(concat!(
                "INSERT INTO attempt_log (job, attempt, position, text, written_at) \
                 VALUES ($1, $2, $3, $4, ",
                now!(),
                ") ON CONFLICT (attempt, position) DO UPDATE SET text = excluded.text"
            ))
            .bind(job)
            .bind(attempt)
            .bind(integer(chunk.position))
            .bind(&chunk.text);
            self.execute(statement).await?;
        }
        Ok(())
    }

    pub async fn set_log_bytes(&mut self, attempt: i64, bytes: u64) -> Result<(), sqlx::Error> {
        let statement = sqlx::query("UPDATE attempt SET log_bytes = $1 WHERE id = $2")
            .bind(integer(bytes))
            .bind(attempt);
        self.execute(statement).await
    }

    /// Deletes the chunks that begin at `from` or later, and before `to`.
    pub async fn delete_log_between(
        &mut self,
        attempt: i64,
        from: u64,
        to: u64,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "DELETE FROM attempt_log WHERE attempt = $1 AND position >= $2 AND position < $3",
        )
        .bind(attempt)
        .bind(integer(from))
        .bind(integer(to));
        self.execute(statement).await
    }

    /// Marks the ended attempts of a job, except the newest `kept`, as having no log, and returns
    /// them.
    pub async fn forget_logs(&mut self, job: JobId, kept: u32) -> Result<Vec<i64>, sqlx::Error> {
        sqlx::query_scalar(
            "UPDATE attempt SET log_bytes = NULL WHERE id IN (SELECT id FROM attempt \
                 WHERE job = $1 AND log_bytes IS NOT NULL AND ended_at IS NOT NULL \
                 ORDER BY id DESC LIMIT 9223372036854775807 OFFSET $2) RETURNING id",
        )
        .bind(job)
        .bind(i64::from(kept))
        .fetch_all(self.connection())
        .await
    }

    pub async fn delete_log(&mut self, attempt: i64) -> Result<(), sqlx::Error> {
        self.execute(sqlx::query("DELETE FROM attempt_log WHERE attempt = $1").bind(attempt)).await
    }
}

impl FromRow<'_, DbRow> for LogChunk {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            attempt: row.try_get("attempt")?,
            task: row.try_get("task")?,
            label: row.try_get("label")?,
            worker: row.try_get("worker")?,
            position: number(row, "position")?,
            text: row.try_get("text")?,
            written_at: row.try_get("written_at")?,
        })
    }
}

impl FromRow<'_, DbRow> for NewLogChunk {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self { position: number(row, "position")?, text: row.try_get("text")? })
    }
}
