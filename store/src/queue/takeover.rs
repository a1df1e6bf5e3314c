//! Takes over the shards and checkpoints that an earlier job with the same digest committed before
//! it failed or was cancelled. The same digest means the same bytes, so the new job need not make
//! them again.

use serde_json::Value;

use crate::database::patience::patiently;
use crate::database::query::sql;
use crate::database::{Reading, Scope, Transaction};
use crate::queue::fences;
use crate::results::datasets::shards_from_rows;
use crate::{Checkpoint, DatasetId, Fence, JobId, RunId, ShardContents, Store, StoreError, boxed};

/// A shard of another job with the same digest.
#[derive(Clone, Debug)]
pub struct EarlierShard {
    /// What the shard has, with its files.
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
        let mut reading = self.read("looking for an earlier shard");
        let newest: Option<DatasetId> = sql(
            "SELECT dataset.id FROM job \
             JOIN job AS other ON other.digest = job.digest AND other.id <> job.id \
             JOIN dataset ON dataset.job = other.id JOIN shard ON shard.dataset = dataset.id \
             WHERE job.id = $1 AND job.takes_over AND shard.ordinal = $2 AND dataset.deleted_at IS NULL \
             ORDER BY dataset.id DESC LIMIT 1",
        )
        .bind(job)
        .bind(ordinal)
        .optional(&mut reading)
        .await?;
        let Some(dataset) = newest else { return Ok(None) };
        let rows = sql(
            "SELECT shard.*, file.content, file.path, file.size, file.sha256, task.result \
             FROM shard JOIN task ON task.id = shard.task \
             JOIN shard_file AS file ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
             WHERE shard.dataset = $1 AND shard.ordinal = $2",
        )
        .bind(dataset)
        .bind(ordinal)
        .rows(&mut reading)
        .await?;
        let Some(row) = rows.first() else { return Ok(None) };
        let result: Option<Value> = row.get("result")?;
        let shard = shards_from_rows(&rows)?.pop();
        Ok(shard.map(|shard| EarlierShard { contents: shard.contents, result }))
    }

    /// The checkpoints of another job with `job`'s digest, sorted by step: of the job that got
    /// furthest. Empty for a job that was submitted to run anew.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn earlier_checkpoints(&self, job: JobId) -> Result<Vec<Checkpoint>, StoreError> {
        const OPERATION: &str = "looking for earlier checkpoints";
        match self.read(OPERATION).farthest_training(job).await? {
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
            let (_, run) = fences::held_run(&mut tx, fence).await?;
            for key in tx.copy_metrics(from, run, step).await? {
                tx.set_latest(run, &key).await?;
            }
            tx.commit().await
        })
    }
}

impl Reading<'_> {
    pub async fn farthest_training(&mut self, job: JobId) -> Result<Option<JobId>, StoreError> {
        sql("SELECT other.id FROM job \
             JOIN job AS other ON other.digest = job.digest AND other.id <> job.id \
             JOIN checkpoint ON checkpoint.job = other.id \
             WHERE job.id = $1 AND job.takes_over AND checkpoint.deleted_at IS NULL \
             ORDER BY checkpoint.step DESC, other.id DESC LIMIT 1")
        .bind(job)
        .optional(self)
        .await
    }
}

impl Transaction {
    /// Returns the copied keys.
    pub async fn copy_metrics(
        &mut self,
        from: RunId,
        to: RunId,
        step: u64,
    ) -> Result<Vec<String>, StoreError> {
        sql(
            "INSERT INTO metric (run, key, step, time, value) \
             SELECT $1, key, step, time, value FROM metric WHERE run = $2 AND step <= $3 \
             ON CONFLICT (run, key, step) DO UPDATE SET time = excluded.time, value = excluded.value",
        )
        .bind(to)
        .bind(from)
        .bind(step)
        .changed(self)
        .await?;
        sql("SELECT DISTINCT key FROM metric WHERE run = $1").bind(to).all(self).await
    }
}
