//! Tasks, as they are looked up; see `leases` for how they are worked on.

use serde_json::Value;
use wire::TaskState;

use crate::database::sql;
use crate::{Epoch, JobId, Progress, Store, StoreError, TaskId, Timestamp};

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
        let tasks = sql!(self.database(), "reading a job's tasks", tasks(job))?;
        if tasks.is_empty() {
            // A pipeline has none either, and that is no error.
            self.job(job).await?;
        }
        Ok(tasks)
    }

    /// # Errors
    /// When there is no such task.
    pub async fn task(&self, id: TaskId) -> Result<Task, StoreError> {
        sql!(self.database(), "reading a task", task(id))?
            .ok_or_else(|| StoreError::not_found("task", id.to_string()))
    }
}
