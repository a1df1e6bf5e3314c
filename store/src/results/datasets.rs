//! Datasets and their shards. A job that makes a dataset has it from its submission on and fills
//! it.

use std::collections::BTreeMap;
use std::ops::Range;

use serde_json::Value;
use spec::Digest;
use wire::DatasetState;

use crate::database::column::json;
use crate::database::patience::patiently;
use crate::database::query::{FromRow, Row, from_row, sql};
use crate::database::rows::{deletion, tags};
use crate::database::{Reading, Transaction};
use crate::lists::listing::Listed;
use crate::parquet::file_content::FileContent;
use crate::queue::task_end::Completion;
use crate::trash::refuse_deleted;
use crate::{
    DatasetId, Deletion, Fence, ItemKind, JobId, Listing, Page, Store, StoreError, StoredObject,
    Timestamp, boxed,
};

/// The state of a dataset. It is building as long as its job can still fill it.
macro_rules! standing {
    () => {
        "CASE WHEN dataset.state = 'building' AND job.state IN ('failed', 'cancelled') \
         THEN 'abandoned' ELSE dataset.state END"
    };
}
pub(crate) use standing;
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
            "{tags dataset_tag dataset dataset.id}",
            " AS own_tags, ",
            "{tags job_tag job dataset.job}",
            " AS job_tags FROM dataset JOIN job ON job.id = dataset.job ",
            $($rest),+
        )
    };
}

/// A dataset as it is now.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Its id.
    pub id: DatasetId,
    /// The job that fills it.
    pub job: JobId,
    /// The job's digest.
    pub digest: Digest,
    /// The name that users gave it, or the name of its job.
    pub name: String,
    /// A note in Markdown.
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Tags of the job, sorted.
    pub job_tags: Vec<String>,
    /// The spec of its job.
    pub spec: Value,
    /// Whether all its shards exist.
    pub state: DatasetState,
    /// Number of trajectories when it is complete.
    pub trajectories: u64,
    /// Number of samples of each trajectory.
    pub samples: u32,
    /// Shards committed so far.
    pub shards: u64,
    /// Draws refused so far.
    pub rejected: u64,
    /// Size of all files so far.
    pub bytes: u64,
    /// When its job was submitted.
    pub created_at: Timestamp,
    /// When its last shard was committed.
    pub completed_at: Option<Timestamp>,
    /// When it was moved to the trash; `None` if it was not.
    pub deletion: Option<Deletion>,
}

/// A committed shard.
#[derive(Clone, Debug)]
pub struct Shard {
    /// The dataset that it is a part of.
    pub dataset: DatasetId,
    /// Its place in the dataset.
    pub ordinal: u32,
    /// What it has, with its files.
    pub contents: ShardContents,
}

/// The trajectories of a shard and the files that hold them.
#[derive(Clone, Debug)]
pub struct ShardContents {
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of trajectories.
    pub count: u64,
    /// Number of draws that were rejected on the way to its trajectories.
    pub rejected: u64,
    /// The file with the samples.
    pub trajectories: StoredObject,
    /// The file with a row for each trajectory: its robot and its excitation.
    pub robots: StoredObject,
}

impl ShardContents {
    /// Indices of the trajectories.
    pub const fn range(&self) -> Range<u64> {
        self.first..self.first + self.count
    }

    /// The file with this content.
    pub const fn file(&self, content: FileContent) -> &StoredObject {
        match content {
            FileContent::Trajectories => &self.trajectories,
            FileContent::Robots => &self.robots,
        }
    }

    /// Its files, each with its content.
    pub fn files(&self) -> [(FileContent, &StoredObject); 2] {
        FileContent::ALL.map(|content| (content, self.file(content)))
    }
}

/// Where the number of a dataset's trajectories comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    /// From the dataset's row, since the submission.
    Submitted,
    /// From its only shard.
    OfShard,
}

impl Store {
    /// A page of the list of datasets.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_datasets(&self, listing: &Listing) -> Result<Listed<Dataset>, StoreError> {
        let found = self.found(ItemKind::Dataset, listing).await?;
        let ids: Vec<DatasetId> = found.ids.iter().copied().map(DatasetId).collect();
        let rows = self.datasets_by_id(&ids).await?;
        Ok(found.with(rows, |dataset| dataset.id.0))
    }

    /// Commits the shard of the fence's task and completes the task. The task's ordinal is the
    /// shard's index. The last shard completes dataset and job in the same transaction. Repeating
    /// the call does no harm.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn commit_shard(
        &self,
        fence: Fence,
        shard: &ShardContents,
        result: Option<&Value>,
    ) -> Result<(), StoreError> {
        self.commit(fence, shard, result, Count::Submitted).await
    }

    /// Like [`Self::commit_shard`], for the one shard of an import. It sets the dataset's number of
    /// trajectories.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn commit_import(
        &self,
        fence: Fence,
        shard: &ShardContents,
        result: &Value,
    ) -> Result<(), StoreError> {
        self.commit(fence, shard, Some(result), Count::OfShard).await
    }

    async fn commit(
        &self,
        fence: Fence,
        shard: &ShardContents,
        result: Option<&Value>,
        trajectories: Count,
    ) -> Result<(), StoreError> {
        const OPERATION: &str = "committing a shard";
        patiently!({
            for (_, file) in shard.files() {
                self.objects().verify_published(file).await?;
            }
            let begun = Completion::begin(self, fence, OPERATION).await;
            if let Err(StoreError::LeaseLost { .. }) = begun
                && self.read(OPERATION).is_committed(fence, shard.trajectories.sha256).await?
            {
                // The same commit succeeded before, and its answer was lost.
                return Ok(());
            }
            let mut completion = begun?;
            completion.tx.insert_shard(fence, shard).await?;
            if trajectories == Count::OfShard {
                completion.tx.set_trajectories(completion.job, shard.count).await?;
                completion.tx.set_total(fence.task, shard.count).await?;
            }
            completion.end(result).await
        })
    }

    /// # Errors
    /// When there is no such dataset, or it was deleted.
    #[boxed]
    pub async fn dataset(&self, id: DatasetId) -> Result<Dataset, StoreError> {
        let found = self
            .read("reading a dataset")
            .dataset(id)
            .await?
            .ok_or_else(|| StoreError::not_found("dataset", id.to_string()))?;
        refuse_deleted(id, found.deletion.as_ref())?;
        Ok(found)
    }

    /// Datasets, newest first; in every state if `state` is `None`.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn datasets(
        &self,
        state: Option<DatasetState>,
        page: Page,
    ) -> Result<Vec<Dataset>, StoreError> {
        let state = state.map(|state| state.as_str().to_owned());
        Ok(self.list_datasets(&Listing { state, ..page.into() }).await?.items)
    }

    /// Those of the datasets with these ids that exist, sorted by id.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn datasets_by_id(&self, ids: &[DatasetId]) -> Result<Vec<Dataset>, StoreError> {
        sql(select_dataset!(
            "WHERE dataset.deleted_at IS NULL AND dataset.id IN ",
            "{ids $1}",
            " ORDER BY dataset.id"
        ))
        .bind(json(&ids))
        .all(&mut self.read("reading datasets"))
        .await
    }

    /// Pairs of a job and its dataset, for those of `jobs` that fill one.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn datasets_of_jobs(
        &self,
        jobs: &[JobId],
    ) -> Result<Vec<(JobId, DatasetId)>, StoreError> {
        sql("SELECT job, id FROM dataset WHERE deleted_at IS NULL AND job IN {ids $1} \
             ORDER BY job")
        .bind(json(&jobs))
        .all(&mut self.read("looking up the datasets of jobs"))
        .await
    }

    /// The newest complete dataset of a digest.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn dataset_by_digest(&self, digest: Digest) -> Result<Option<Dataset>, StoreError> {
        sql(select_dataset!(
            "WHERE dataset.digest = $1 AND dataset.state = 'complete' AND dataset.deleted_at IS NULL \
             ORDER BY dataset.id DESC LIMIT 1"
        ))
        .bind(digest)
        .optional(&mut self.read("looking up a dataset by digest"))
        .await
    }

    /// The shards in order. While the dataset is building, those that are committed.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn shards(&self, dataset: DatasetId) -> Result<Vec<Shard>, StoreError> {
        let rows = sql(
            "SELECT shard.*, file.content, file.path, file.size, file.sha256 FROM shard \
             JOIN shard_file AS file ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
             WHERE shard.dataset = $1 ORDER BY shard.ordinal, file.content",
        )
        .bind(dataset)
        .rows(&mut self.read("reading a dataset's shards"))
        .await?;
        shards_from_rows(&rows)
    }
}

impl Reading<'_> {
    pub async fn dataset(&mut self, id: DatasetId) -> Result<Option<Dataset>, StoreError> {
        sql(select_dataset!("WHERE dataset.id = $1")).bind(id).optional(self).await
    }

    /// Whether the shard with this digest was committed at the fence's epoch.
    pub async fn is_committed(&mut self, fence: Fence, sha256: Digest) -> Result<bool, StoreError> {
        sql("SELECT EXISTS (SELECT 1 FROM shard JOIN shard_file AS file \
             ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
             WHERE shard.task = $1 AND shard.epoch = $2 AND file.content = 'trajectories' \
             AND file.sha256 = $3)")
        .bind(fence.task)
        .bind(fence.epoch)
        .bind(sha256)
        .one(self)
        .await
    }

    /// The results of the tasks that made a dataset's shards, as text.
    pub async fn shard_results(&mut self, dataset: DatasetId) -> Result<Vec<String>, StoreError> {
        let results: Vec<Option<String>> =
            sql("SELECT task.result FROM shard JOIN task ON task.id = shard.task \
             WHERE shard.dataset = $1 ORDER BY shard.ordinal")
            .bind(dataset)
            .all(self)
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
    ) -> Result<(), StoreError> {
        sql("INSERT INTO dataset (job, digest, state, trajectories, samples, created_at) \
             VALUES ($1, $2, 'building', $3, $4, {now})")
        .bind(job)
        .bind(digest)
        .bind(trajectories)
        .bind(samples)
        .run(self)
        .await
    }

    /// Inserts the shard of a task. The task's ordinal is the shard's index.
    pub async fn insert_shard(
        &mut self,
        fence: Fence,
        shard: &ShardContents,
    ) -> Result<(), StoreError> {
        let (dataset, ordinal): (DatasetId, i64) =
            sql("INSERT INTO shard (dataset, ordinal, first, count, rejected, task, epoch) \
             SELECT dataset.id, task.ordinal, $1, $2, $3, task.id, task.epoch \
             FROM task JOIN dataset ON dataset.job = task.job WHERE task.id = $4 \
             RETURNING dataset, ordinal")
            .bind(shard.first)
            .bind(shard.count)
            .bind(shard.rejected)
            .bind(fence.task)
            .one(self)
            .await?;
        for (content, object) in shard.files() {
            sql("INSERT INTO shard_file (dataset, ordinal, content, path, size, sha256) \
                 VALUES ($1, $2, $3, $4, $5, $6)")
            .bind(dataset)
            .bind(ordinal)
            .bind(content)
            .bind(&object.path)
            .bind(object.size)
            .bind(object.sha256)
            .changed(self)
            .await?;
        }
        Ok(())
    }

    pub async fn set_trajectories(
        &mut self,
        job: JobId,
        trajectories: u64,
    ) -> Result<(), StoreError> {
        sql("UPDATE dataset SET trajectories = $1 WHERE job = $2")
            .bind(trajectories)
            .bind(job)
            .run(self)
            .await
    }

    /// Completes the dataset of a job, if it has one and all its trajectories are committed.
    pub async fn complete_dataset(&mut self, job: JobId) -> Result<(), StoreError> {
        sql("UPDATE dataset SET state = 'complete', completed_at = {now} WHERE job = $1 \
             AND trajectories = (SELECT SUM(shard.count) FROM shard \
             WHERE shard.dataset = dataset.id)")
        .bind(job)
        .run(self)
        .await
    }
}

pub(crate) fn shards_from_rows(rows: &[Row]) -> Result<Vec<Shard>, StoreError> {
    let mut shards = Vec::with_capacity(rows.len() / 2);
    for files in rows.chunk_by(same_shard) {
        let mut objects = files
            .iter()
            .map(|row| Ok((row.get("content")?, StoredObject::from_row(row)?)))
            .collect::<Result<BTreeMap<FileContent, StoredObject>, StoreError>>()?;
        let row = &files[0];
        let mut take = |content| objects.remove(&content).ok_or_else(|| row.incomplete());
        shards.push(Shard {
            dataset: row.get("dataset")?,
            ordinal: row.get("ordinal")?,
            contents: ShardContents {
                first: row.get("first")?,
                count: row.get("count")?,
                rejected: row.get("rejected")?,
                trajectories: take(FileContent::Trajectories)?,
                robots: take(FileContent::Robots)?,
            },
        });
    }
    Ok(shards)
}

fn same_shard(a: &Row, b: &Row) -> bool {
    let ordinal = |row: &Row| row.get::<i64>("ordinal").ok();
    ordinal(a) == ordinal(b)
}

from_row!(Dataset {
    id, job, digest, name, note, spec, state, trajectories, samples, shards, rejected, bytes,
    created_at, completed_at,
    ..row =>
    tags: tags(row, "own_tags")?,
    job_tags: tags(row, "job_tags")?,
    deletion: deletion(row)?,
});
