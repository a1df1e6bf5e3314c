//! Datasets and their shards. A job whose output is one fills it, and has it from its submission on.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::Digest;
use wire::DatasetState;

use crate::boxed;
use crate::database::sql;
use crate::patience::patiently;
use crate::task_end::Completion;
use crate::trash::refuse_deleted;
use crate::{
    DatasetId, Deletion, Fence, JobId, Listing, Page, Store, StoreError, StoredObject, Timestamp,
};

#[derive(Clone, Debug)]
pub struct Dataset {
    pub id: DatasetId,
    pub job: JobId,
    /// The job's.
    pub digest: Digest,
    /// As people call it, or else its job.
    pub name: String,
    pub note: Option<String>,
    /// In order.
    pub tags: Vec<String>,
    /// The job's, in order.
    pub job_tags: Vec<String>,
    pub spec: Value,
    pub state: DatasetState,
    /// When complete.
    pub trajectories: u64,
    /// Of each trajectory.
    pub samples: u32,
    /// So far.
    pub shards: u64,
    /// Draws refused so far.
    pub rejected: u64,
    /// Of all files so far.
    pub bytes: u64,
    pub created_at: Timestamp,
    pub completed_at: Option<Timestamp>,
    pub deletion: Option<Deletion>,
}

/// The two files of a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FileContent {
    /// A row per time step.
    Trajectories,
    /// A row per trajectory: its robot and its excitation.
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

    /// Rows of the file of a shard with so many trajectories of so many samples.
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

/// Where it stands how many trajectories a dataset has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    /// In its row since the submission.
    Submitted,
    /// In its one shard.
    OfShard,
}

impl Store {
    /// Commits the shard of the fence's task, whose ordinal it has, and completes the task; the
    /// last shard completes dataset and job in the same transaction. Harmless when repeated.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    #[boxed]
    pub async fn commit_shard(
        &self,
        fence: Fence,
        shard: &ShardContents,
        result: Option<&Value>,
    ) -> Result<(), StoreError> {
        self.commit(fence, shard, result, Count::Submitted).await
    }

    /// The same for the one shard of an import, which tells how many trajectories the dataset has.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
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
                // This very commit went through before, its answer lost on the way.
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

    /// Newest first; all states without a `state`.
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

    /// Those of the datasets with these ids that there are, by id.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn datasets_by_id(&self, ids: &[DatasetId]) -> Result<Vec<Dataset>, StoreError> {
        sql!(self.database(), "reading datasets", datasets_by_id(ids))
    }

    /// Each of `jobs` that fills a dataset, beside it.
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

    /// In order; while the dataset is building, those that are there.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn shards(&self, dataset: DatasetId) -> Result<Vec<Shard>, StoreError> {
        sql!(self.database(), "reading a dataset's shards", shards(dataset))
    }
}
