//! The queue as a whole: whether tasks are claimed, and how many there are.

use crate::database::query::sql;
use crate::database::{Scope, Transaction};
use crate::{Store, StoreError, Timestamp, boxed};

/// The state of the queue as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Queue {
    /// The moment since when the queue is paused.
    pub paused_at: Option<Timestamp>,
    /// Number of queued tasks: those that may be claimed now, from a moment on, or after the pause.
    pub queued: u64,
    /// Number of tasks that workers have.
    pub running: u64,
}

impl Store {
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn queue(&self) -> Result<Queue, StoreError> {
        let (paused_at, queued, running): (Option<Timestamp>, i64, i64) =
            sql("SELECT (SELECT paused_at FROM queue), \
             (SELECT COUNT(*) FROM task WHERE state = 'queued'), \
             (SELECT COUNT(*) FROM task WHERE state = 'running')")
            .one(&mut self.read("reading the queue"))
            .await?;
        Ok(Queue { paused_at, queued: queued.unsigned_abs(), running: running.unsigned_abs() })
    }

    /// Pauses the queue: no more tasks are claimed. Running tasks go on, and jobs can still be
    /// submitted.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn pause_queue(&self) -> Result<(), StoreError> {
        const OPERATION: &str = "pausing the queue";
        let mut tx = self.begin(Scope::Rows, OPERATION).await?;
        tx.pause_queue().await?;
        tx.commit().await?;
        // A claim that began before the pause may be committed after it.
        let mut tx = self.begin(Scope::Rows, OPERATION).await?;
        tx.wait_for_claims().await?;
        tx.commit().await
    }

    /// Resumes the queue: tasks are claimed again.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn resume_queue(&self) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "resuming the queue").await?;
        tx.resume_queue().await?;
        tx.commit().await
    }
}

impl Transaction {
    /// Pauses the queue. If it is paused already, the time of the pause stays.
    pub async fn pause_queue(&mut self) -> Result<(), StoreError> {
        sql("UPDATE queue SET paused_at = COALESCE(paused_at, {now})").run(self).await
    }

    pub async fn resume_queue(&mut self) -> Result<(), StoreError> {
        sql("UPDATE queue SET paused_at = NULL").run(self).await?;
        self.ring().await
    }
}
