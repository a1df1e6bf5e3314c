//! Fences: whether a worker may still write for a task.

use crate::database::Transaction;
use crate::queue::rules::task::TaskStanding;
use crate::{Fence, JobId, RunId, StoreError};

pub(crate) fn lease_lost(fence: Fence) -> StoreError {
    StoreError::LeaseLost { task: fence.task, epoch: fence.epoch }
}

/// The job of a leased task, and where the task stands.
///
/// # Errors
/// [`StoreError::LeaseLost`] unless the task is running at the fence's epoch. The answer holds
/// until the transaction ends.
pub(crate) async fn held(
    tx: &mut Transaction,
    fence: Fence,
) -> Result<(JobId, TaskStanding), StoreError> {
    tx.standing(fence.task)
        .await?
        .filter(|(_, standing)| standing.is_held_at(fence.epoch))
        .ok_or_else(|| lease_lost(fence))
}

/// Like [`held`], and returns the transaction. If the lease is lost, the transaction is rolled back
/// at once: a transaction that is only dropped ends a moment later, and until then it hides the
/// task from claims.
///
/// # Errors
/// Like [`held`].
pub(crate) async fn held_or_rolled_back(
    mut tx: Transaction,
    fence: Fence,
) -> Result<(Transaction, JobId, TaskStanding), StoreError> {
    match held(&mut tx, fence).await {
        Ok((job, standing)) => Ok((tx, job, standing)),
        Err(error) => {
            tx.roll_back().await?;
            Err(error)
        }
    }
}

/// Like [`held`], and tells whether another task of the same stage is queued.
///
/// # Errors
/// Like [`held`]. The answer about the stage may change while tasks are claimed.
pub(crate) async fn held_in_stage(
    tx: &mut Transaction,
    fence: Fence,
) -> Result<(JobId, TaskStanding, bool), StoreError> {
    tx.standing_in_stage(fence.task)
        .await?
        .filter(|(_, standing, _)| standing.is_held_at(fence.epoch))
        .ok_or_else(|| lease_lost(fence))
}

/// The job of a leased task and its run.
pub(crate) async fn held_run(
    tx: &mut Transaction,
    fence: Fence,
) -> Result<(JobId, RunId), StoreError> {
    let (job, _) = held(tx, fence).await?;
    let run = tx.run_id(job).await?;
    let run = run.ok_or_else(|| StoreError::not_found("run of job", job.to_string()))?;
    Ok((job, run))
}
