//! Attempts: which worker had a task, from when to when, and how the attempt ended.

use wire::AttemptOutcome;

use crate::boxed;
use crate::database::sql;
use crate::{Epoch, JobId, Page, Store, StoreError, TaskId, Timestamp};

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attempt {
    pub id: i64,
    pub task: TaskId,
    /// The task's label.
    pub label: String,
    pub epoch: Epoch,
    pub worker: String,
    /// `None` while the attempt is running.
    pub outcome: Option<AttemptOutcome>,
    /// Why it failed, or why the worker had to give the task back.
    pub reason: Option<String>,
    pub started_at: Timestamp,
    pub ended_at: Option<Timestamp>,
    /// Bytes logged, including those that were dropped; `None` without a log.
    pub log_bytes: Option<u64>,
}

impl Store {
    /// The attempts at a job's tasks, newest first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn attempts(&self, job: JobId, page: Page) -> Result<Vec<Attempt>, StoreError> {
        sql!(self.database(), "reading a job's attempts", attempts(job, page))
    }

    /// Whether a worker has ever begun a task.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn has_begun_a_task(&self, worker: &str) -> Result<bool, StoreError> {
        sql!(self.database(), "looking for a worker's attempts", has_begun_a_task(worker))
    }
}
