use std::collections::BTreeMap;

use spec::Digest;
use sqlx::types::Json;
use sqlx::{FromRow, Row};

use super::rows::{deletion, digest, file_content, json, number, state, stored_object, tags};
use super::{Database, DbRow, Transaction, integer};
use crate::{Dataset, DatasetId, Fence, FileContent, JobId, Shard, ShardContents, StoredObject};

/// The state of a dataset. It is building as long as its job can still fill it.
macro_rules! standing {
    () => {
        "CASE WHEN dataset.state = 'building' AND job.state IN ('failed', 'cancelled') \
         THEN 'abandoned' ELSE dataset.state END"
    };
}
pub(super) use standing;

macro_rules! select_dataset {
    ($($rest:expr),+ $(,)?) => {
        concat!(
            "SELECT dataset.id, dataset.job, dataset.digest, dataset.trajectories, dataset.samples, \
             dataset.created_at, dataset.completed_at, dataset.deleted_at, dataset.purge_at, \
             dataset.purged_at, dataset.deletion_reason, dataset.note, ",
            standing!(),
            " AS state, COALESCE(dataset.given_name, job.given_name, job.name) AS name, job.spec, \
             (SELECT COUNT(*) FROM shard WHERE shard.dataset = dataset.id) AS shards, \
             (SELECT CAST(COALESCE(SUM(rejected), 0) AS BIGINT) FROM shard WHERE shard.dataset = dataset.id) \
             AS rejected, \
             (SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM shard_file WHERE shard_file.dataset = dataset.id) \
             AS bytes, ",
            tags_of!("dataset_tag", "dataset", "dataset.id"),
            " AS own_tags, ",
            tags_of!("job_tag", "job", "dataset.job"),
            " AS job_tags FROM dataset JOIN job ON job.id = dataset.job ",
            $($rest),+
        )
    };
}

impl Database {
    pub async fn dataset(&self, id: DatasetId) -> Result<Option<Dataset>, sqlx::Error> {
        sqlx::query_as(select_dataset!("WHERE dataset.id = $1"))
            .bind(id)
            .fetch_optional(&self.reader)
            .await
    }

    /// Whether the shard with this digest was committed at the fence's epoch.
    pub async fn is_committed(&self, fence: Fence, sha256: Digest) -> Result<bool, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM shard JOIN shard_file AS file \
             ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
             WHERE shard.task = $1 AND shard.epoch = $2 AND file.content = 'trajectories' \
             AND file.sha256 = $3)",
        )
        .bind(fence.task)
        .bind(fence.epoch)
        .bind(sha256.to_string())
        .fetch_one(&self.reader)
        .await
    }

    pub async fn datasets_by_id(&self, ids: &[DatasetId]) -> Result<Vec<Dataset>, sqlx::Error> {
        sqlx::query_as(select_dataset!(
            "WHERE dataset.deleted_at IS NULL AND dataset.id IN ",
            listed_ids!("$1"),
            " ORDER BY dataset.id"
        ))
        .bind(Json(ids))
        .fetch_all(&self.reader)
        .await
    }

    pub async fn datasets_of_jobs(
        &self,
        jobs: &[JobId],
    ) -> Result<Vec<(JobId, DatasetId)>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT job, id FROM dataset WHERE deleted_at IS NULL AND job IN ",
            listed_ids!("$1"),
            " ORDER BY job"
        ))
        .bind(Json(jobs))
        .fetch_all(&self.reader)
        .await
    }

    pub async fn dataset_by_digest(&self, digest: Digest) -> Result<Option<Dataset>, sqlx::Error> {
        sqlx::query_as(select_dataset!(
            "WHERE dataset.digest = $1 AND dataset.state = 'complete' AND dataset.deleted_at IS NULL \
             ORDER BY dataset.id DESC LIMIT 1"
        ))
        .bind(digest.to_string())
        .fetch_optional(&self.reader)
        .await
    }

    pub async fn shards(&self, dataset: DatasetId) -> Result<Vec<Shard>, sqlx::Error> {
        let rows = sqlx::query(
            "SELECT shard.*, file.content, file.path, file.size, file.sha256 FROM shard \
             JOIN shard_file AS file ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
             WHERE shard.dataset = $1 ORDER BY shard.ordinal, file.content",
        )
        .bind(dataset)
        .fetch_all(&self.reader)
        .await?;
        shards_from_rows(&rows)
    }

    /// The results of the tasks that made a dataset's shards, as text.
    pub async fn shard_results(&self, dataset: DatasetId) -> Result<Vec<String>, sqlx::Error> {
        let results: Vec<Option<String>> = sqlx::query_scalar(
            "SELECT task.result FROM shard JOIN task ON task.id = shard.task \
             WHERE shard.dataset = $1 ORDER BY shard.ordinal",
        )
        .bind(dataset)
        .fetch_all(&self.reader)
        .await?;
        Ok(results.into_iter().flatten().collect())
    }
}

impl Transaction {
    pub async fn insert_dataset(
        &mut self,
        job: JobId,
        digest: Digest,
        trajectories: u64,
        samples: u32,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO dataset (job, digest, state, trajectories, samples, created_at) ",
            "VALUES ($1, $2, 'building', $3, $4, ",
            now!(),
            ")"
        ))
        .bind(job)
        .bind(digest.to_string())
        .bind(integer(trajectories))
        .bind(i64::from(samples));
        self.execute(statement).await
    }

    /// Inserts the shard of a task. The task's ordinal is the shard's index.
    pub async fn insert_shard(
        &mut self,
        fence: Fence,
        shard: &ShardContents,
    ) -> Result<(), sqlx::Error> {
        let (dataset, ordinal): (DatasetId, i64) = sqlx::query_as(
            "INSERT INTO shard (dataset, ordinal, first, count, rejected, task, epoch) \
             SELECT dataset.id, task.ordinal, $1, $2, $3, task.id, task.epoch \
             FROM task JOIN dataset ON dataset.job = task.job WHERE task.id = $4 \
             RETURNING dataset, ordinal",
        )
        .bind(integer(shard.first))
        .bind(integer(shard.count))
        .bind(integer(shard.rejected))
        .bind(fence.task)
        .fetch_one(self.connection())
        .await?;
        for (content, object) in shard.files() {
            sqlx::query(
                "INSERT INTO shard_file (dataset, ordinal, content, path, size, sha256) \
                 VALUES ($1, $2, $3, $4, $5, $6)",
            )
            .bind(dataset)
            .bind(ordinal)
            .bind(content.as_str())
            .bind(&object.path)
            .bind(integer(object.size))
            .bind(object.sha256.to_string())
            .execute(self.connection())
            .await?;
        }
        Ok(())
    }

    pub async fn set_trajectories(
        &mut self,
        job: JobId,
        trajectories: u64,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query("UPDATE dataset SET trajectories = $1 WHERE job = $2")
            .bind(integer(trajectories))
            .bind(job);
        self.execute(statement).await
    }

    /// Completes the dataset of a job, if it has one and all its trajectories are committed.
    pub async fn complete_dataset(&mut self, job: JobId) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE dataset SET state = 'complete', completed_at = ",
            now!(),
            " WHERE job = $1 AND trajectories = \
              (SELECT SUM(shard.count) FROM shard WHERE shard.dataset = dataset.id)"
        ))
        .bind(job);
        self.execute(statement).await
    }
}

pub(super) fn shards_from_rows(rows: &[DbRow]) -> Result<Vec<Shard>, sqlx::Error> {
    let mut shards = Vec::with_capacity(rows.len() / 2);
    for files in rows.chunk_by(same_shard) {
        let mut objects = files
            .iter()
            .map(|row| Ok((file_content(row)?, stored_object(row)?)))
            .collect::<Result<BTreeMap<FileContent, StoredObject>, sqlx::Error>>()?;
        let mut take = |content| objects.remove(&content).ok_or(sqlx::Error::RowNotFound);
        let row = &files[0];
        shards.push(Shard {
            dataset: row.try_get("dataset")?,
            ordinal: number(row, "ordinal")?,
            contents: ShardContents {
                first: number(row, "first")?,
                count: number(row, "count")?,
                rejected: number(row, "rejected")?,
                trajectories: take(FileContent::Trajectories)?,
                robots: take(FileContent::Robots)?,
            },
        });
    }
    Ok(shards)
}

fn same_shard(a: &DbRow, b: &DbRow) -> bool {
    let ordinal = |row: &DbRow| row.try_get::<i64, _>("ordinal").ok();
    ordinal(a) == ordinal(b)
}

impl FromRow<'_, DbRow> for Dataset {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            digest: digest(row, "digest")?,
            name: row.try_get("name")?,
            note: row.try_get("note")?,
            tags: tags(row, "own_tags")?,
            job_tags: tags(row, "job_tags")?,
            spec: json(row, "spec")?,
            state: state(row)?,
            trajectories: number(row, "trajectories")?,
            samples: number(row, "samples")?,
            shards: number(row, "shards")?,
            rejected: number(row, "rejected")?,
            bytes: number(row, "bytes")?,
            created_at: row.try_get("created_at")?,
            completed_at: row.try_get("completed_at")?,
            deletion: deletion(row)?,
        })
    }
}
