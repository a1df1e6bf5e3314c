use serde_json::Value;
use sqlx::Row;

use super::datasets::shards_from_rows;
use super::rows::json;
use super::{Database, Transaction, integer};
use crate::queue::takeover::EarlierShard;
use crate::{DatasetId, JobId, RunId};

impl Database {
    pub async fn earlier_shard(
        &self,
        job: JobId,
        ordinal: u32,
    ) -> Result<Option<EarlierShard>, sqlx::Error> {
        let newest: Option<DatasetId> = sqlx::query_scalar(
            "SELECT dataset.id FROM job \
             JOIN job AS other ON other.digest = job.digest AND other.id <> job.id \
             JOIN dataset ON dataset.job = other.id JOIN shard ON shard.dataset = dataset.id \
             WHERE job.id = $1 AND job.takes_over AND shard.ordinal = $2 AND dataset.deleted_at IS NULL \
             ORDER BY dataset.id DESC LIMIT 1",
        )
        .bind(job)
        .bind(i64::from(ordinal))
        .fetch_optional(&self.reader)
        .await?;
        let Some(dataset) = newest else { return Ok(None) };
        let rows = sqlx::query(
            "SELECT shard.*, file.content, file.path, file.size, file.sha256, task.result \
             FROM shard JOIN task ON task.id = shard.task \
             JOIN shard_file AS file ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
             WHERE shard.dataset = $1 AND shard.ordinal = $2",
        )
        .bind(dataset)
        .bind(i64::from(ordinal))
        .fetch_all(&self.reader)
        .await?;
        let Some(row) = rows.first() else { return Ok(None) };
        let result: Option<&str> = row.try_get("result")?;
        let result: Option<Value> = result.map(|_| json(row, "result")).transpose()?;
        let shard = shards_from_rows(&rows)?.pop();
        Ok(shard.map(|shard| EarlierShard { contents: shard.contents, result }))
    }

    pub async fn farthest_training(&self, job: JobId) -> Result<Option<JobId>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT other.id FROM job \
             JOIN job AS other ON other.digest = job.digest AND other.id <> job.id \
             JOIN checkpoint ON checkpoint.job = other.id \
             WHERE job.id = $1 AND job.takes_over AND checkpoint.deleted_at IS NULL \
             ORDER BY checkpoint.step DESC, other.id DESC LIMIT 1",
        )
        .bind(job)
        .fetch_optional(&self.reader)
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
    ) -> Result<Vec<String>, sqlx::Error> {
        sqlx::query(
            "INSERT INTO metric (run, key, step, time, value) \
             SELECT $1, key, step, time, value FROM metric WHERE run = $2 AND step <= $3 \
             ON CONFLICT (run, key, step) DO UPDATE SET time = excluded.time, value = excluded.value",
        )
        .bind(to)
        .bind(from)
        .bind(integer(step))
        .execute(self.connection())
        .await?;
        sqlx::query_scalar("SELECT DISTINCT key FROM metric WHERE run = $1")
            .bind(to)
            .fetch_all(self.connection())
            .await
    }
}
