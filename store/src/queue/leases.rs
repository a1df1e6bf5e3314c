//! Leases: how a worker gets a task, keeps it and loses it.
//!
//! A claim raises the task's epoch. Every later write of the worker carries that epoch, and changes
//! nothing if the task has a newer one. So a worker that was wrongly thought dead does no harm.
//!
//! A lease ends in one of seven ways:
//!
//! - *completed*: in the transaction that commits the results.
//! - *failed*: the task is tried again if the reason may pass and attempts are left.
//! - *released*: a worker that shuts down gives the task back. No attempt is counted.
//! - *deferred*: there was no room for the results, or their place was gone. The task waits a
//!   while, and no attempt is counted.
//! - *stopped*: the task's job was cancelled.
//! - *reaped*: there was no heartbeat. The task goes to the next worker.
//! - *taken back*: the server saw its worker process end, or the scheduler that placed the worker
//!   says so. After a preemption no attempt is counted.
//!
//! After its second failure a task may be claimed from a moment on (`run_at`). A moment farther
//! ahead than any delay counts as passed. `not_before` is another column: its user chose it, so it
//! is waited for whatever the clock does.

use std::time::Duration;

use spec::Resources;

use crate::boxed;
use crate::database::{Claim, Scope, Transaction};
use crate::queue::{fences, pipelines};
use crate::{ClaimedTask, Fence, IdlePoll, JobId, Progress, Store, StoreError};

/// The answer to the renewal of a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lease {
    /// The worker still has the task.
    Held {
        /// Whether the worker should stop at once, because the job was cancelled.
        cancel_requested: bool,
    },
    /// The lease is lost, and another worker may have the task: stop.
    Lost,
}

impl Store {
    /// Asks for a task that `worker` could claim, without claiming it. Idle workers poll often, and
    /// should not take SQLite's write lock only to find nothing.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn poll(&self, worker: &str, offers: &Resources) -> Result<IdlePoll, StoreError> {
        self.read("looking for a task").poll(worker, offers).await
    }

    /// Leases the next task that asks for no more than `worker` offers, for `ttl`. The attempt
    /// counts from here on. A drained worker gets no task.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn claim(
        &self,
        worker: &str,
        offers: &Resources,
        ttl: Duration,
    ) -> Result<Option<ClaimedTask>, StoreError> {
        let claim = self.database().claim(worker, offers, ttl, "claiming a task").await?;
        let Some(Claim { next, open }) = claim else { return Ok(None) };
        let begins_its_job = next.begins_its_job();
        let task = next.claimed();
        match open {
            Some(mut tx) => {
                if begins_its_job {
                    start(&mut tx, task.job).await?;
                }
                tx.commit().await?;
            }
            None if begins_its_job => {
                if let Err(error) = self.start_in_turn(task.job).await {
                    // The job is shown as running with its next task, or it ends without.
                    tracing::warn!(job = %task.job, %error, "is not shown as running");
                }
            }
            None => {}
        }
        Ok(Some(task))
    }

    async fn start_in_turn(&self, job: JobId) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Queue, "starting a job").await?;
        start(&mut tx, job).await?;
        tx.commit().await
    }

    /// Prolongs a lease to `ttl` from now and records progress.
    ///
    /// # Errors
    /// When the database fails. A lost lease is an answer, not an error.
    #[boxed]
    pub async fn renew(
        &self,
        fence: Fence,
        ttl: Duration,
        progress: &Progress,
    ) -> Result<Lease, StoreError> {
        let tx = self.begin(Scope::Lease, "renewing a lease").await?;
        let (mut tx, standing) = match fences::held_or_rolled_back(tx, fence).await {
            Ok((tx, _, standing)) => (tx, standing),
            Err(StoreError::LeaseLost { .. }) => return Ok(Lease::Lost),
            Err(error) => return Err(error),
        };
        tx.renew(fence.task, ttl, progress).await?;
        tx.commit().await?;
        Ok(Lease::Held { cancel_requested: standing.cancel_requested })
    }

    /// Replaces a leased task's total, for work whose amount shows only once it begins.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn set_total(&self, fence: Fence, total: u64) -> Result<(), StoreError> {
        let tx = self.begin(Scope::Lease, "setting the total of a task").await?;
        let (mut tx, _, _) = fences::held_or_rolled_back(tx, fence).await?;
        tx.set_total(fence.task, total).await?;
        tx.commit().await
    }
}

/// Shows a job as running after its first task was claimed.
async fn start(tx: &mut Transaction, job: JobId) -> Result<(), StoreError> {
    if tx.start_job(job).await? {
        pipelines::settle_pipelines_of(tx, job).await?;
    }
    Ok(())
}
