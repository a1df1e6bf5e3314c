use std::time::Duration;

use serde_json::Value;
use spec::Digest;
use sqlx::types::Json;
use sqlx::{QueryBuilder, Row};
use wire::ItemKind;

use super::rows::{deletion, digest, json, number, word};
use super::{Database, Db, DbRow, LISTED_IDS, Transaction, milliseconds};
use crate::trash::ItemRow;
use crate::trash::retention::OldCheckpoint;
use crate::{CheckpointId, Deletion, Item, JobId, Timestamp, TrashPlace, Trashed};

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

/// The items in the trash, without those that were deleted together with their owner. The size
/// covers their own files and the files of items that were deleted with them.
const TRASH: &str = "SELECT * FROM (\
     SELECT 'job' AS kind, job.id, job.name, job.deleted_at, job.purge_at, job.purged_at, job.deletion_reason, \
         (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM dataset \
              JOIN shard_file AS file ON file.dataset = dataset.id WHERE dataset.job = job.id) \
         + (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM run \
              JOIN artifact AS file ON file.run = run.id WHERE run.job = job.id) \
         + (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM checkpoint \
              JOIN checkpoint_file AS file ON file.checkpoint = checkpoint.id WHERE checkpoint.job = job.id) AS bytes \
     FROM job WHERE job.deleted_at IS NOT NULL AND job.purged_at IS NULL \
     AND NOT EXISTS (SELECT 1 FROM pipeline_member AS member JOIN job AS pipeline ON pipeline.id = member.pipeline \
         WHERE member.job = job.id AND pipeline.deleted_at = job.deleted_at) \
     UNION ALL SELECT 'run', run.id, job.name, run.deleted_at, run.purge_at, run.purged_at, run.deletion_reason, \
         (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM artifact AS file WHERE file.run = run.id) \
         + (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM checkpoint \
              JOIN checkpoint_file AS file ON file.checkpoint = checkpoint.id WHERE checkpoint.run = run.id) \
     FROM run JOIN job ON job.id = run.job WHERE run.deleted_at IS NOT NULL AND run.purged_at IS NULL \
     AND (job.deleted_at IS NULL OR job.deleted_at <> run.deleted_at) \
     UNION ALL SELECT 'dataset', dataset.id, job.name, dataset.deleted_at, dataset.purge_at, dataset.purged_at, \
         dataset.deletion_reason, \
         (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM shard_file AS file WHERE file.dataset = dataset.id) \
     FROM dataset JOIN job ON job.id = dataset.job WHERE dataset.deleted_at IS NOT NULL AND dataset.purged_at IS NULL \
     AND (job.deleted_at IS NULL OR job.deleted_at <> dataset.deleted_at) \
     UNION ALL SELECT 'checkpoint', checkpoint.id, job.name, checkpoint.deleted_at, checkpoint.purge_at, \
         checkpoint.purged_at, checkpoint.deletion_reason, \
         (SELECT CAST(COALESCE(SUM(file.size), 0) AS BIGINT) FROM checkpoint_file AS file \
          WHERE file.checkpoint = checkpoint.id) \
     FROM checkpoint JOIN job ON job.id = checkpoint.job JOIN run ON run.id = checkpoint.run \
     WHERE checkpoint.deleted_at IS NOT NULL AND checkpoint.purged_at IS NULL \
     AND (run.deleted_at IS NULL OR run.deleted_at <> checkpoint.deleted_at)) AS trash";

impl Database {
    pub async fn trash(
        &self,
        after: Option<TrashPlace>,
        limit: u32,
    ) -> Result<Vec<Trashed>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(TRASH);
        if let Some(TrashPlace { deleted_at, item }) = after {
            query.push(" WHERE (deleted_at, kind, id) < (").push_bind(deleted_at);
            query.push(", ").push_bind(item.kind.as_str()).push(", ").push_bind(item.id).push(")");
        }
        query.push(" ORDER BY deleted_at DESC, kind DESC, id DESC LIMIT ");
        query.push_bind(i64::from(limit));
        let rows = query.build().fetch_all(&self.reader).await?;
        let trashed = |row: &DbRow| {
            Ok(Trashed {
                item: Item::new(word(row, "kind")?, row.try_get("id")?),
                name: row.try_get("name")?,
                bytes: number(row, "bytes")?,
                deletion: deletion(row)?.ok_or(sqlx::Error::RowNotFound)?,
            })
        };
        rows.iter().map(trashed).collect()
    }

    /// By id, those after `after`: checkpoints of trainings that have ended and have `keep` newer ones. The final one, the best and
    /// those with a name, a note or a tag are left out.
    pub async fn old_checkpoints(
        &self,
        keep: u32,
        after: CheckpointId,
        limit: u32,
    ) -> Result<Vec<OldCheckpoint>, sqlx::Error> {
        let rows = sqlx::query(
            "SELECT * FROM (SELECT checkpoint.id, checkpoint.step, checkpoint.is_final, checkpoint.is_best, \
                 checkpoint.given_name, checkpoint.note, job.name, job.digest, \
                 ROW_NUMBER() OVER (PARTITION BY checkpoint.job ORDER BY checkpoint.step DESC) AS place \
                 FROM checkpoint JOIN job ON job.id = checkpoint.job \
                 WHERE checkpoint.deleted_at IS NULL AND job.deleted_at IS NULL \
                 AND job.state IN ('succeeded', 'failed', 'cancelled')) AS ranked \
             WHERE place > $1 AND NOT is_final AND NOT is_best AND given_name IS NULL AND note IS NULL \
             AND NOT EXISTS (SELECT 1 FROM checkpoint_tag WHERE checkpoint_tag.checkpoint = ranked.id) \
             AND id > $2 ORDER BY id LIMIT $3",
        )
        .bind(i64::from(keep))
        .bind(after)
        .bind(i64::from(limit))
        .fetch_all(&self.reader)
        .await?;
        let old = |row: &DbRow| {
            Ok(OldCheckpoint {
                id: row.try_get("id")?,
                step: number(row, "step")?,
                name: row.try_get("name")?,
                digest: digest(row, "digest")?,
            })
        };
        rows.iter().map(old).collect()
    }

    /// The specs of jobs that read what a digest stands for.
    pub async fn specs_that_name(&self, read: Digest) -> Result<Vec<Value>, sqlx::Error> {
        let rows = sqlx::query(
            "SELECT spec FROM job WHERE deleted_at IS NULL \
             AND id IN (SELECT job FROM job_input WHERE digest = $1)",
        )
        .bind(read.to_string())
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(|row| json(row, "spec")).collect()
    }

    /// Jobs that ended so long ago and have logs, by id.
    pub async fn jobs_with_old_logs(
        &self,
        age: Duration,
        limit: Option<u32>,
    ) -> Result<Vec<JobId>, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "SELECT id FROM job WHERE state IN ('succeeded', 'failed', 'cancelled') AND finished_at <= ",
            now!(),
            " - $1 AND EXISTS (SELECT 1 FROM attempt WHERE attempt.job = job.id AND attempt.log_bytes IS NOT NULL) \
             ORDER BY id LIMIT $2"
        ))
        .bind(milliseconds(age))
        .bind(limit.map_or(i64::MAX, i64::from))
        .fetch_all(&self.reader)
        .await
    }

    /// Jobs that failed or were cancelled at least this long ago. Pipelines only count if no member
    /// succeeded.
    pub async fn failed_jobs(
        &self,
        age: Duration,
        limit: u32,
    ) -> Result<Vec<(JobId, String)>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT job.id, job.name FROM job WHERE job.state IN ('failed', 'cancelled') \
             AND job.deleted_at IS NULL AND job.finished_at <= ",
            now!(),
            " - $1 AND NOT EXISTS (SELECT 1 FROM pipeline_member AS part JOIN job AS made ON made.id = part.job \
                 WHERE part.pipeline = job.id AND made.state = 'succeeded') \
             AND NOT EXISTS (SELECT 1 FROM pipeline_member AS part JOIN job AS holder ON holder.id = part.pipeline \
                 WHERE part.job = job.id AND holder.deleted_at IS NULL) \
             ORDER BY job.id LIMIT $2"
        ))
        .bind(milliseconds(age))
        .bind(i64::from(limit))
        .fetch_all(&self.reader)
        .await
    }

    /// The size of all sent files, for imports and for tracked runs.
    pub async fn sent_bytes(&self) -> Result<u64, sqlx::Error> {
        let bytes: i64 = sqlx::query_scalar(
            "SELECT (SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM upload) \
             + (SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM tracked_artifact)",
        )
        .fetch_one(&self.reader)
        .await?;
        Ok(bytes.unsigned_abs())
    }

    /// The size of the files of items of one kind.
    pub async fn size_of(&self, kind: ItemKind, ids: &[i64]) -> Result<u64, sqlx::Error> {
        let (table, column) = match kind {
            ItemKind::Job => return Ok(0),
            ItemKind::Run => ("artifact", "run"),
            ItemKind::Dataset => ("shard_file", "dataset"),
            ItemKind::Checkpoint => ("checkpoint_file", "checkpoint"),
        };
        let mut query = QueryBuilder::<Db>::new(format!(
            "SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM {table} WHERE {column} IN "
        ));
        query.push(LISTED_IDS.0).push_bind(Json(ids.to_vec())).push(LISTED_IDS.1);
        let bytes: i64 = query.build_query_scalar().fetch_one(&self.reader).await?;
        Ok(bytes.unsigned_abs())
    }
}

impl Transaction {
    /// The current time by the database's clock.
    pub async fn present(&mut self) -> Result<Timestamp, sqlx::Error> {
        sqlx::query_scalar(concat!("SELECT ", now!())).fetch_one(self.connection()).await
    }

    pub async fn item(&mut self, item: Item) -> Result<Option<ItemRow>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(select_item(item.kind));
        query.push_bind(item.id);
        let row = query.build().fetch_optional(self.connection()).await?;
        let found = |row: DbRow| {
            Ok(ItemRow {
                item,
                job: row.try_get("job")?,
                job_state: word(&row, "state")?,
                digest: digest(&row, "digest")?,
                deletion: deletion(&row)?,
                owner_deleted_at: row.try_get("owner_deleted_at")?,
            })
        };
        row.map(found).transpose()
    }

    /// Ended members of a pipeline that belong to it alone: they were made for it, nobody asked for
    /// them by themselves, and no other pipeline has them.
    pub async fn owned_members(
        &mut self,
        pipeline: JobId,
    ) -> Result<Vec<(JobId, Digest)>, sqlx::Error> {
        let rows = sqlx::query(
            "SELECT job.id, job.digest FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1 AND NOT member.reused AND NOT job.asked_alone \
             AND job.deleted_at IS NULL AND job.state IN ('succeeded', 'failed', 'cancelled') \
             AND NOT EXISTS (SELECT 1 FROM pipeline_member AS other \
                 JOIN job AS holder ON holder.id = other.pipeline \
                 WHERE other.job = member.job AND other.pipeline <> member.pipeline \
                 AND holder.deleted_at IS NULL)",
        )
        .bind(pipeline)
        .fetch_all(self.connection())
        .await?;
        rows.iter().map(|row| Ok((row.try_get("id")?, digest(row, "digest")?))).collect()
    }

    /// Members that were deleted together with their pipeline.
    pub async fn members_deleted_with(
        &mut self,
        pipeline: JobId,
        at: Timestamp,
    ) -> Result<Vec<JobId>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT DISTINCT job.id FROM pipeline_member AS member JOIN job ON job.id = member.job \
             WHERE member.pipeline = $1 AND job.deleted_at = $2",
        )
        .bind(pipeline)
        .bind(at)
        .fetch_all(self.connection())
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
    ) -> Result<Vec<Item>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!("UPDATE {kind} SET deleted_at = "));
        query.push_bind(deletion.deleted_at);
        query.push(", purge_at = ").push_bind(deletion.purge_at);
        query.push(", deletion_reason = ").push_bind(deletion.reason.clone());
        query.push(format!(" WHERE deleted_at IS NULL AND {column} IN ")).push(LISTED_IDS.0);
        query.push_bind(Json(ids.to_vec())).push(LISTED_IDS.1).push(" RETURNING id");
        self.items(kind, query).await
    }

    /// Restores items that were deleted at this moment and not purged. Returns them.
    pub async fn mark_restored(
        &mut self,
        kind: ItemKind,
        column: &str,
        ids: &[i64],
        at: Timestamp,
    ) -> Result<Vec<Item>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!(
            "UPDATE {kind} SET deleted_at = NULL, purge_at = NULL, deletion_reason = NULL \
             WHERE purged_at IS NULL AND deleted_at = "
        ));
        query.push_bind(at).push(format!(" AND {column} IN ")).push(LISTED_IDS.0);
        query.push_bind(Json(ids.to_vec())).push(LISTED_IDS.1).push(" RETURNING id");
        self.items(kind, query).await
    }

    pub async fn items_not_deleted(
        &mut self,
        kind: ItemKind,
        column: &str,
        ids: &[i64],
    ) -> Result<Vec<Item>, sqlx::Error> {
        let mut query = QueryBuilder::<Db>::new(format!(
            "SELECT id FROM {kind} WHERE deleted_at IS NULL AND {column} IN "
        ));
        query.push(LISTED_IDS.0).push_bind(Json(ids.to_vec())).push(LISTED_IDS.1);
        query.push(" ORDER BY id");
        self.items(kind, query).await
    }

    async fn items(
        &mut self,
        kind: ItemKind,
        mut query: QueryBuilder<Db>,
    ) -> Result<Vec<Item>, sqlx::Error> {
        let ids: Vec<i64> = query.build_query_scalar().fetch_all(self.connection()).await?;
        Ok(ids.into_iter().map(|id| Item::new(kind, id)).collect())
    }
}
