//! Attempts: which worker had a task, from when to when, and how the attempt ended.

use wire::AttemptOutcome;

use crate::database::Transaction;
use crate::database::query::{FromRow, Row, sql};
use crate::{Epoch, Fence, JobId, Page, Store, StoreError, TaskId, Timestamp, boxed};

/// An attempt at a task: the time from a claim to its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attempt {
    /// Its id. Later attempts have larger ones.
    pub id: i64,
    /// The claimed task.
    pub task: TaskId,
    /// The task's label.
    pub label: String,
    /// The epoch of the claim.
    pub epoch: Epoch,
    /// The name of the worker.
    pub worker: String,
    /// `None` while the attempt is running.
    pub outcome: Option<AttemptOutcome>,
    /// Why it failed, or why the worker had to give the task back.
    pub reason: Option<String>,
    /// When the worker claimed the task.
    pub started_at: Timestamp,
    /// When it ended; `None` while it lasts.
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
        sql("SELECT attempt.*, task.label FROM attempt JOIN task ON task.id = attempt.task \
             WHERE attempt.job = $1 AND attempt.id < $2 ORDER BY attempt.id DESC LIMIT $3")
        .bind(job)
        .bind(page.before())
        .bind(page.limit())
        .all(&mut self.read("reading a job's attempts"))
        .await
    }

    /// Whether a worker has ever begun a task.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn has_begun_a_task(&self, worker: &str) -> Result<bool, StoreError> {
        sql("SELECT EXISTS (SELECT 1 FROM attempt WHERE worker = $1)")
            .bind(worker)
            .one(&mut self.read("looking for a worker's attempts"))
            .await
    }
}

impl Transaction {
    /// Does nothing for a task that was claimed by a version without attempts.
    pub async fn end_attempt(
        &mut self,
        fence: Fence,
        outcome: AttemptOutcome,
        reason: Option<&str>,
    ) -> Result<(), StoreError> {
        sql("UPDATE attempt SET outcome = $1, reason = $2, ended_at = {now} WHERE task = $3 \
             AND epoch = $4")
        .bind(outcome)
        .bind(reason)
        .bind(fence.task)
        .bind(fence.epoch)
        .run(self)
        .await
    }

    /// Records why a worker gave its last task back, unless a reason is known.
    pub async fn explain_release(&mut self, worker: &str, reason: &str) -> Result<(), StoreError> {
        sql(
            "UPDATE attempt SET reason = $1 WHERE id = (SELECT MAX(id) FROM attempt WHERE worker = $2) \
             AND outcome = 'released' AND reason IS NULL",
        )
        .bind(reason)
        .bind(worker).run(self).await
    }
}

impl FromRow for Attempt {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let outcome: Option<AttemptOutcome> = row.get("outcome")?;
        Ok(Self {
            id: row.get("id")?,
            task: row.get("task")?,
            label: row.get("label")?,
            epoch: row.get("epoch")?,
            worker: row.get("worker")?,
            outcome,
            reason: row.get("reason")?,
            started_at: row.get("started_at")?,
            ended_at: row.get("ended_at")?,
            log_bytes: row.get("log_bytes")?,
        })
    }
}
