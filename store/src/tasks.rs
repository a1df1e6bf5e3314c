//! Tasks, as they are looked up; see `leases` for how they are worked on.

use serde_json::Value;
use sqlx::sqlite::SqliteRow;
use sqlx::types::Text;
use sqlx::{FromRow, Row};

use crate::{Epoch, JobId, Progress, Store, StoreError, TaskId, TaskState, Timestamp, jobs};

#[derive(Clone, Debug)]
pub struct Task {
    pub id: TaskId,
    pub job: JobId,
    pub stage: u32,
    pub ordinal: u32,
    pub label: String,
    pub payload: Value,
    pub state: TaskState,
    /// Times it was claimed.
    pub attempt: u32,
    pub max_attempts: u32,
    pub epoch: Epoch,
    /// Who has it, or had it last.
    pub worker: Option<String>,
    pub lease_until: Option<Timestamp>,
    pub cancel_requested: bool,
    pub progress: Progress,
    /// How much of the job's unit it does.
    pub total: u64,
    /// What it was completed with.
    pub result: Option<Value>,
    /// Of the last attempt that failed.
    pub error: Option<String>,
    pub started_at: Option<Timestamp>,
    pub finished_at: Option<Timestamp>,
}

impl Store {
    /// In the order in which they run.
    ///
    /// # Errors
    /// When there is no such job.
    pub async fn tasks(&self, job: JobId) -> Result<Vec<Task>, StoreError> {
        let tasks: Vec<Task> =
            sqlx::query_as("SELECT * FROM task WHERE job = ? ORDER BY stage, ordinal")
                .bind(job)
                .fetch_all(self.database().reader())
                .await
                .map_err(StoreError::database("reading a job's tasks"))?;
        if tasks.is_empty() {
            // A pipeline has none either, and that is no error.
            self.job(job).await?;
        }
        Ok(tasks)
    }

    /// # Errors
    /// When there is no such task.
    pub async fn task(&self, id: TaskId) -> Result<Task, StoreError> {
        sqlx::query_as("SELECT * FROM task WHERE id = ?")
            .bind(id)
            .fetch_optional(self.database().reader())
            .await
            .map_err(StoreError::database("reading a task"))?
            .ok_or_else(|| StoreError::not_found("task", id.to_string()))
    }
}

impl FromRow<'_, SqliteRow> for Task {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        let result: Option<&str> = row.try_get("result")?;
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            stage: row.try_get("stage")?,
            ordinal: row.try_get("ordinal")?,
            label: row.try_get("label")?,
            payload: jobs::json(row, "payload")?,
            state: row.try_get::<Text<_>, _>("state")?.0,
            attempt: row.try_get("attempt")?,
            max_attempts: row.try_get("max_attempts")?,
            epoch: row.try_get("epoch")?,
            worker: row.try_get("worker")?,
            lease_until: row.try_get("lease_until")?,
            cancel_requested: row.try_get("cancel_requested")?,
            progress: Progress {
                done: row.try_get("done")?,
                rate_per_second: row.try_get("rate")?,
                message: row.try_get("message")?,
            },
            total: row.try_get("total")?,
            result: result.map(|_| jobs::json(row, "result")).transpose()?,
            error: row.try_get("error")?,
            started_at: row.try_get("started_at")?,
            finished_at: row.try_get("finished_at")?,
        })
    }
}
