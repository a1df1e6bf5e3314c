//! The queue as a whole: whether tasks are claimed, and how many there are.

use crate::boxed;
use crate::database::{Scope, sql};
use crate::{Store, StoreError, Timestamp};

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
        sql!(self.database(), "reading the queue", queue())
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
        sql!(&mut tx, pause_queue())?;
        tx.commit().await?;
        // A claim that began before the pause may be committed after it.
        let mut tx = self.begin(Scope::Rows, OPERATION).await?;
        sql!(&mut tx, wait_for_claims())?;
        tx.commit().await
    }

    /// Resumes the queue: tasks are claimed again.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn resume_queue(&self) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "resuming the queue").await?;
        sql!(&mut tx, resume_queue())?;
        tx.commit().await
    }
}
