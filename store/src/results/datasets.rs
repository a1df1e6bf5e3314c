//! Datasets and their shards. A job that makes a dataset has it from its submission on and fills
//! it.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::Digest;
use wire::DatasetState;

use crate::boxed;
use crate::database::patience::patiently;
use crate::database::sql;
use crate::queue::task_end::Completion;
use crate::trash::refuse_deleted;
use crate::{
    DatasetId, Deletion, Fence, JobId, Listing, Page, Store, StoreError, StoredObject, Timestamp,
};

#[derive(Clone, Debug)]
pub struct Dataset {
    pub id: DatasetId,
    pub job: JobId,
    /// The job's digest.
    pub digest: Digest,
    /// The name that users gave it, or the name of its job.
    pub name: String,
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Tags of the job, sorted.
    pub job_tags: Vec<String>,
    pub spec: Value,
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
    pub created_at: Timestamp,
    pub completed_at: Option<Timestamp>,
    pub deletion: Option<Deletion>,
}

/// The two files of a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FileContent {
    /// One row per time step.
    Trajectories,
    /// One row per trajectory: its robot and its excitation.
    Robots,
}

impl FileContent {
    pub const ALL: [Self; 2] = [Self::Trajectories, Self::Robots];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Trajectories => "trajectories",
            Self::Robots => "robots",
        }
    }

    /// The name under which the file of a shard is downloaded, e.g. `trajectories-00003.parquet`.
    pub fn file_name(self, shard: u32) -> String {
        format!("{self}-{shard:05}.parquet")
    }

    /// The number of rows of a shard's file with this many trajectories of this many samples.
    pub fn rows(self, trajectories: u64, samples: u32) -> u64 {
        match self {
            Self::Trajectories => trajectories * u64::from(samples),
            Self::Robots => trajectories,
        }
    }
}

impl fmt::Display for FileContent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// A committed shard.
#[derive(Clone, Debug)]
pub struct Shard {
    pub dataset: DatasetId,
    pub ordinal: u32,
    pub contents: ShardContents,
}

/// The trajectories of a shard and the files that hold them.
#[derive(Clone, Debug)]
pub struct ShardContents {
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of trajectories.
    pub count: u64,
    pub rejected: u64,
    pub trajectories: StoredObject,
    pub robots: StoredObject,
}

impl ShardContents {
    /// Indices of the trajectories.
    pub const fn range(&self) -> Range<u64> {
        self.first..self.first + self.count
    }

    pub const fn file(&self, content: FileContent) -> &StoredObject {
        match content {
            FileContent::Trajectories => &self.trajectories,
            FileContent::Robots => &self.robots,
        }
    }

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
                && sql!(self.database(), OPERATION, is_committed(fence, shard.trajectories.sha256))?
            {
                // The same commit succeeded before, and its answer was lost.
                return Ok(());
            }
            let mut completion = begun?;
            sql!(&mut completion.tx, insert_shard(fence, shard))?;
            if trajectories == Count::OfShard {
                sql!(&mut completion.tx, set_trajectories(completion.job, shard.count))?;
                sql!(&mut completion.tx, set_total(fence.task, shard.count))?;
            }
            completion.end(result).await
        })
    }

    /// # Errors
    /// When there is no such dataset, or it was deleted.
    #[boxed]
    pub async fn dataset(&self, id: DatasetId) -> Result<Dataset, StoreError> {
        let found = sql!(self.database(), "reading a dataset", dataset(id))?
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
        sql!(self.database(), "reading datasets", datasets_by_id(ids))
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
        sql!(self.database(), "looking up the datasets of jobs", datasets_of_jobs(jobs))
    }

    /// The newest complete dataset of a digest.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn dataset_by_digest(&self, digest: Digest) -> Result<Option<Dataset>, StoreError> {
        sql!(self.database(), "looking up a dataset by digest", dataset_by_digest(digest))
    }

    /// The shards in order. While the dataset is building, those that are committed.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn shards(&self, dataset: DatasetId) -> Result<Vec<Shard>, StoreError> {
        sql!(self.database(), "reading a dataset's shards", shards(dataset))
    }
}
