//! Takes over the shards and checkpoints that an earlier job with the same digest committed before
//! it failed or was cancelled. The same digest means the same bytes, so the new job need not make
//! them again.

use serde_json::Value;

use crate::boxed;
use crate::database::patience::patiently;
use crate::database::{Scope, sql};
use crate::queue::leases;
use crate::{Checkpoint, Fence, JobId, RunId, ShardContents, Store, StoreError};

/// A shard of another job with the same digest.
#[derive(Clone, Debug)]
pub struct EarlierShard {
    pub contents: ShardContents,
    /// The result of the task that made it.
    pub result: Option<Value>,
}

impl Store {
    /// The shard with this ordinal from the newest other job that has `job`'s digest and such a
    /// shard. `None` for a job that was submitted to run anew.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn earlier_shard(
        &self,
        job: JobId,
        ordinal: u32,
    ) -> Result<Option<EarlierShard>, StoreError> {
        sql!(self.database(), "looking for an earlier shard", earlier_shard(job, ordinal))
    }

    /// The checkpoints of another job with `job`'s digest, sorted by step: of the job that got
    /// furthest. Empty for a job that was submitted to run anew.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn earlier_checkpoints(&self, job: JobId) -> Result<Vec<Checkpoint>, StoreError> {
        const OPERATION: &str = "looking for earlier checkpoints";
        match sql!(self.database(), OPERATION, farthest_training(job))? {
            Some(earlier) => self.checkpoints_of_job(earlier).await,
            None => Ok(Vec::new()),
        }
    }

    /// Copies the metrics of another run up to `step` into the run of the fence's job.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn take_over_metrics(
        &self,
        fence: Fence,
        from: RunId,
        step: u64,
    ) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Rows, "taking over metrics").await?;
            let (_, run) = leases::held_run(&mut tx, fence).await?;
            for key in sql!(&mut tx, copy_metrics(from, run, step))? {
                sql!(&mut tx, set_latest(run, &key))?;
            }
            tx.commit().await
        })
    }
}
