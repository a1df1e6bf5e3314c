//! Deleted items, as rows.

use std::time::Duration;

use serde_json::Value;
use spec::Digest;
use wire::{ItemKind, JobState};

use crate::database::query::{Query, Row, sql};
use crate::database::rows::deletion;
use crate::database::{Reading, Transaction};
use crate::trash::names::name_of;
use crate::{CheckpointId, Deletion, Item, JobId, StoreError, Timestamp};

/// The row of an item.
#[derive(Clone, Debug)]
pub(crate) struct ItemRow {
    pub item: Item,
    /// The job that made it, or the item itself if it is a job.
    pub job: JobId,
    pub job_state: JobState,
    pub digest: Digest,
    pub deletion: Option<Deletion>,
    /// The moment at which its owner was deleted.
    pub owner_deleted_at: Option<Timestamp>,
}

/// A checkpoint that is not among the newest of its training, not final, not the best and not labelled.
#[derive(Clone, Debug)]
pub(crate) struct OldCheckpoint {
    pub id: CheckpointId,
    pub step: u64,
    /// The training's name and the step.
    pub name: String,
    /// The training's digest.
    pub digest: Digest,
}

/// Selects items, each with its job's state and the moment at which its owner was deleted.
const fn select_item(kind: ItemKind) -> &'static str {
    match kind {
        ItemKind::Job => {
            "SELECT job.id AS job, job.state, job.digest, job.deleted_at, job.purge_at, job.purged_at, \
             job.deletion_reason, CAST(NULL AS BIGINT) AS owner_deleted_at FROM job WHERE job.id = "
        }
        ItemKind::Run => {
            "SELECT run.job, job.state, job.digest, run.deleted_at, run.purge_at, run.purged_at, \
             run.deletion_reason, job.deleted_at AS owner_deleted_at \
             FROM run JOIN job ON job.id = run.job WHERE run.id = "
        }
        ItemKind::Dataset => {
            "SELECT dataset.job, job.state, job.digest, dataset.deleted_at, dataset.purge_at, \
             dataset.purged_at, dataset.deletion_reason, job.deleted_at AS owner_deleted_at \
             FROM dataset JOIN job ON job.id = dataset.job WHERE dataset.id = "
        }
        ItemKind::Checkpoint => {
            "SELECT checkpoint.job, job.state, job.digest, checkpoint.deleted_at, checkpoint.purge_at, \
             checkpoint.purged_at, checkpoint.deletion_reason, run.deleted_at AS owner_deleted_at \
             FROM checkpoint JOIN job ON job.id = checkpoint.job JOIN run ON run.id = checkpoint.run \
             WHERE checkpoint.id = "
        }
    }
}

impl Reading<'_> {
    /// Reads old checkpoints by id, from the one after `after`: those of trainings that have ended and have `keep` newer ones.
    /// The final one, the best and those with a name, a note, a tag or an alias are left out.
    pub async fn old_checkpoints(
        &mut self,
        keep: u32,
        after: CheckpointId,
        limit: u32,
    ) -> Result<Vec<OldCheckpoint>, StoreError> {
        let name = name_of(ItemKind::Checkpoint, "job");
        let rows = sql(format!(
            "SELECT * FROM (SELECT checkpoint.id, checkpoint.step, checkpoint.is_final, checkpoint.is_best, \
                 checkpoint.given_name, checkpoint.note, {name} AS name, job.digest, \
                 ROW_NUMBER() OVER (PARTITION BY checkpoint.job ORDER BY checkpoint.step DESC) AS place \
                 FROM checkpoint JOIN job ON job.id = checkpoint.job \
                 WHERE checkpoint.deleted_at IS NULL AND job.deleted_at IS NULL \
                 AND job.state IN ('succeeded', 'failed', 'cancelled')) AS ranked \
             WHERE place > $1 AND NOT is_final AND NOT is_best AND given_name IS NULL AND note IS NULL \
             AND NOT EXISTS (SELECT 1 FROM checkpoint_tag WHERE checkpoint_tag.checkpoint = ranked.id) \
             AND NOT EXISTS (SELECT 1 FROM checkpoint_alias WHERE checkpoint_alias.checkpoint = ranked.id) \
             AND id > $2 ORDER BY id LIMIT $3",
        ))
        .bind(keep)
        .bind(after)
        .bind(limit)
        .rows(self)
        .await?;
        let old = |row: &Row| {
            Ok(OldCheckpoint {
                id: row.get("id")?,
                step: row.get("step")?,
                name: row.get("name")?,
                digest: row.get("digest")?,
            })
        };
        rows.iter().map(old).collect()
    }

    /// The specs of jobs that read what a digest stands for.
    pub async fn specs_that_name(&mut self, read: Digest) -> Result<Vec<Value>, StoreError> {
        let rows = sql("SELECT spec FROM job WHERE deleted_at IS NULL \
             AND id IN (SELECT job FROM job_input WHERE digest = $1)")
        .bind(read.to_string())
        .rows(self)
        .await?;
        rows.iter().map(|row| row.get("spec")).collect()
    }

    /// Jobs that ended so long ago and have logs, by id.
    pub async fn jobs_with_old_logs(
        &mut self,
        age: Duration,
        limit: Option<u32>,
    ) -> Result<Vec<JobId>, StoreError> {
        sql("SELECT id FROM job WHERE state IN ('succeeded', 'failed', 'cancelled') \
             AND finished_at <= {now} - $1 AND EXISTS (SELECT 1 FROM attempt \
             WHERE attempt.job = job.id AND attempt.log_bytes IS NOT NULL) ORDER BY id LIMIT $2")
        .bind(age)
        .bind(limit.map_or(i64::MAX, i64::from))
        .all(self)
        .await
    }

    /// Jobs that failed or were cancelled at least this long ago. Pipelines only count if no member
    /// succeeded.
    pub async fn failed_jobs(
        &mut self,
        age: Duration,
        after: JobId,
        limit: u32,
    ) -> Result<Vec<(JobId, String)>, StoreError> {
        let name = name_of(ItemKind::Job, "job");
        sql(format!("SELECT job.id, {name} AS name FROM job WHERE job.state IN ('failed', 'cancelled') \
             AND job.deleted_at IS NULL AND job.id > $2 AND job.finished_at <= {{now}} - $1 AND NOT EXISTS \
             (SELECT 1 FROM pipeline_member AS part JOIN job AS made ON made.id = part.job \
             WHERE part.pipeline = job.id AND made.state = 'succeeded') AND NOT EXISTS (SELECT 1 \
             FROM pipeline_member AS part JOIN job AS holder ON holder.id = part.pipeline \
             WHERE part.job = job.id AND holder.deleted_at IS NULL) ORDER BY job.id LIMIT $3"))
        .bind(age)
        .bind(after)
        .bind(limit)
        .all(self)
        .await
    }

    /// The size of the files of items of one kind.
    pub async fn size_of(&mut self, kind: ItemKind, ids: &[i64]) -> Result<u64, StoreError> {
        let (table, column) = match kind {
            ItemKind::Job => return Ok(0),
            ItemKind::Run => ("artifact", "run"),
            ItemKind::Dataset => ("shard_file", "dataset"),
            ItemKind::Checkpoint => ("checkpoint_file", "checkpoint"),
        };
        let mut query = sql(format!(
            "SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM {table} WHERE {column} IN "
        ));
        query.push_ids(&ids);
        let bytes: i64 = query.one(self).await?;
        Ok(bytes.unsigned_abs())
    }
}

impl Transaction {
    /// The current time by the database's clock.
    pub async fn present(&mut self) -> Result<Timestamp, StoreError> {
        sql("SELECT {now}").one(self).await
    }

    pub async fn item(&mut self, item: Item) -> Result<Option<ItemRow>, StoreError> {
        let mut query = sql(select_item(item.kind));
        query.push_bind(item.id);
        let row = query.optional_row(self).await?;
        let found = |row: Row| {
            Ok(ItemRow {
                item,
                job: row.get("job")?,
                job_state: row.get("state")?,
                digest: row.get("digest")?,
                deletion: deletion(&row)?,
                owner_deleted_at: row.get("owner_deleted_at")?,
            })
        };
        row.map(found).transpose()
    }

    /// Ended members of a pipeline that belong to it alone: they were made for it, nobody asked for
    /// them by themselves, and no other pipeline has them.
    pub async fn owned_members(
        &mut self,
        pipeline: JobId,
    ) -> Result<Vec<(JobId, Digest)>, StoreError> {
        let rows = sql(
            "SELECT job.id, job.digest FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1 AND NOT member.reused AND NOT job.asked_alone \
             AND job.deleted_at IS NULL AND job.state IN ('succeeded', 'failed', 'cancelled') \
             AND NOT EXISTS (SELECT 1 FROM pipeline_member AS other \
                 JOIN job AS holder ON holder.id = other.pipeline \
                 WHERE other.job = member.job AND other.pipeline <> member.pipeline \
                 AND holder.deleted_at IS NULL)",
        )
        .bind(pipeline)
        .rows(self)
        .await?;
        rows.iter().map(|row| Ok((row.get("id")?, row.get("digest")?))).collect()
    }

    /// Members that were deleted together with their pipeline.
    pub async fn members_deleted_with(
        &mut self,
        pipeline: JobId,
        at: Timestamp,
    ) -> Result<Vec<JobId>, StoreError> {
        sql(
            "SELECT DISTINCT job.id FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1 AND job.deleted_at = $2",
        )
        .bind(pipeline)
        .bind(at)
        .all(self)
        .await
    }

    /// Marks items of a kind as deleted, where `column` is in `ids`. Returns those that were not
    /// deleted before.
    pub async fn mark_deleted(
        &mut self,
        kind: ItemKind,
        column: &str,
        ids: &[i64],
        deletion: &Deletion,
    ) -> Result<Vec<Item>, StoreError> {
        let mut query = sql(format!("UPDATE {kind} SET deleted_at = "));
        query.push_bind(deletion.deleted_at);
        query.push(", purge_at = ").push_bind(deletion.purge_at);
        query.push(", deletion_reason = ").push_bind(deletion.reason.clone());
        query
            .push(format!(" WHERE deleted_at IS NULL AND {column} IN "))
            .push_ids(&ids)
            .push(" RETURNING id");
        self.items(kind, query).await
    }

    /// Restores items that were deleted at this moment and not purged. Returns them.
    pub async fn mark_restored(
        &mut self,
        kind: ItemKind,
        column: &str,
        ids: &[i64],
        at: Timestamp,
    ) -> Result<Vec<Item>, StoreError> {
        let mut query = sql(format!(
            "UPDATE {kind} SET deleted_at = NULL, purge_at = NULL, deletion_reason = NULL \
             WHERE purged_at IS NULL AND deleted_at = "
        ));
        query.push_bind(at).push(format!(" AND {column} IN ")).push_ids(&ids).push(" RETURNING id");
        self.items(kind, query).await
    }

    pub async fn items_not_deleted(
        &mut self,
        kind: ItemKind,
        column: &str,
        ids: &[i64],
    ) -> Result<Vec<Item>, StoreError> {
        let mut query =
            sql(format!("SELECT id FROM {kind} WHERE deleted_at IS NULL AND {column} IN "));
        query.push_ids(&ids);
        query.push(" ORDER BY id");
        self.items(kind, query).await
    }

    async fn items(&mut self, kind: ItemKind, query: Query) -> Result<Vec<Item>, StoreError> {
        let ids: Vec<i64> = query.all(self).await?;
        Ok(ids.into_iter().map(|id| Item::new(kind, id)).collect())
    }
}
