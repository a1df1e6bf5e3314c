//! The shards and checkpoints that an earlier job of the same digest committed before it failed or was cancelled,
//! for a new one that need not make them again: the same digest is the same bytes.

use serde_json::Value;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::patience::patiently;
use crate::{Checkpoint, Fence, JobId, RunId, ShardContents, Store, StoreError, leases};

/// A shard of another job of the same digest.
#[derive(Clone, Debug)]
pub struct EarlierShard {
    pub contents: ShardContents,
    /// Its task was completed with this.
    pub result: Option<Value>,
}

impl Store {
    /// The shard with this ordinal of the newest other job of `job`'s digest that has one; none for a job that was
    /// submitted to be done anew.
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

    /// The checkpoints, by step, of the other job of `job`'s digest that came farthest; none for a job that was
    /// submitted to be done anew.
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

    /// Records in the run of the fence's job what another run recorded up to `step`.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
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
