//! Cancellation of jobs by users.

use crate::boxed;
use crate::database::{Scope, Transaction};
use crate::queue::pipelines;
use crate::queue::propagation::{state_of, stop};
use crate::queue::rules::cancellation::members_to_cancel;
use crate::{JobId, Store, StoreError};

impl Store {
    /// Cancels a job. Its queued tasks end now, and its running tasks end when their workers
    /// notice. Cancelling a pipeline cancels the members that no other active job needs. A job that
    /// has ended stays as it is.
    ///
    /// # Errors
    /// When there is no such job.
    #[boxed]
    pub async fn cancel(&self, job: JobId) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Queue, "cancelling a job").await?;
        if state_of(&mut tx, job).await?.is_final() {
            return Ok(());
        }
        tx.request_cancellation(job).await?;
        if tx.has_members(job).await? {
            cancel_members(&mut tx, job).await?;
            pipelines::settle(&mut tx, job).await?;
        } else {
            stop(&mut tx, job).await?;
        }
        tx.commit().await
    }
}

async fn cancel_members(tx: &mut Transaction, pipeline: JobId) -> Result<(), StoreError> {
    let mut candidates = tx.candidates(pipeline).await?;
    for candidate in &mut candidates {
        candidate.needed_by = tx.waiting_dependents(candidate.job).await?;
    }
    let members = members_to_cancel(&candidates);
    // All members are marked before the first one ends, because a pipeline settles when none of its
    // marked members is left.
    for member in &members {
        tx.request_cancellation(*member).await?;
    }
    for member in members {
        stop(tx, member).await?;
    }
    Ok(())
}
