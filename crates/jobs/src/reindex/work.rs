//! The found objects, the rows made from them, and the objects left out.

use std::collections::BTreeMap;

use spec::{Digest, JobSpec};
use store::{Epoch, JobId, NewCheckpoint, RunId, ShardContents, StoreError, StoredObject};
use thiserror::Error;

use crate::SubmissionError;

/// The objects' descriptions of themselves.
#[derive(Debug, Default)]
pub struct FoundObjects {
    pub(super) jobs: BTreeMap<JobId, FoundJob>,
    pub(super) uploads: Vec<StoredObject>,
    /// The largest ids in paths.
    pub(super) last_job: i64,
    pub(super) last_run: i64,
    /// Objects that describe no work.
    pub left_out: Vec<LeftOut>,
}

/// The work of a job.
#[derive(Debug)]
pub(super) struct FoundJob {
    pub spec: JobSpec,
    pub work: FoundWork,
}

#[derive(Debug)]
pub(super) enum FoundWork {
    /// Shards by index.
    Shards(BTreeMap<u32, ShardContents>),
    Training(FoundTraining),
}

#[derive(Debug)]
pub(super) struct FoundTraining {
    pub run: RunId,
    /// Checkpoints by step.
    pub checkpoints: BTreeMap<u64, NewCheckpoint>,
    /// The result of the training, if it ended.
    pub result: Option<serde_json::Value>,
}

/// The number and the epoch in the path of a shard's or a checkpoint's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Written {
    /// The index of the shard, or the step of the checkpoint.
    pub number: u64,
    pub epoch: Epoch,
}

/// An object that the new database does not name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// Its path in the store.
    pub path: String,
    /// Why it is left out, for people.
    pub reason: String,
}

/// The contents of the new database.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rebuilt {
    /// Datasets, complete or not.
    pub datasets: u64,
    /// Shards of all datasets.
    pub shards: u64,
    /// Trainings, ended or not.
    pub trainings: u64,
    /// Checkpoints of all trainings.
    pub checkpoints: u64,
    /// Uploaded files.
    pub uploads: u64,
    /// Jobs with a missing part. Workers make it again.
    pub unfinished: Vec<JobId>,
    /// Objects that the new database does not name.
    pub left_out: Vec<LeftOut>,
}

/// Why no database was rebuilt.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum ReindexError {
    #[error(
        "the database has job {0}; only a database without jobs can be rebuilt: choose a data \
         folder or a database without jobs"
    )]
    HasJobs(JobId),
    #[error("the rebuilt job has id {found} instead of {expected}; repeat with an empty database")]
    OtherId { expected: JobId, found: JobId },
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl FoundObjects {
    /// Number of datasets and trainings that can be rebuilt.
    pub fn jobs(&self) -> usize {
        self.jobs.len()
    }

    pub(super) fn leave_out(&mut self, path: impl Into<String>, reason: impl Into<String>) {
        self.left_out.push(LeftOut { path: path.into(), reason: reason.into() });
    }
}

/// The spec in `text`, if its digest is the stated one.
pub(super) fn checked_spec(text: &[u8], stated: Digest) -> Result<JobSpec, String> {
    let spec = spec::parse(text).map_err(|error| format!("its spec cannot be used: {error}"))?;
    match spec.digest() {
        digest if digest == stated => Ok(spec),
        digest => Err(format!("its spec has digest {digest}, and it says {stated}")),
    }
}

impl FoundWork {
    pub fn paths(&self) -> Vec<String> {
        let objects: Vec<&StoredObject> = match self {
            Self::Shards(shards) => {
                shards.values().flat_map(|shard| [&shard.trajectories, &shard.robots]).collect()
            }
            Self::Training(training) => {
                let files = training.checkpoints.values().flat_map(|checkpoint| &checkpoint.files);
                files.map(|file| &file.object).collect()
            }
        };
        objects.into_iter().map(|object| object.path.clone()).collect()
    }
}

/// Why a found spec cannot be submitted.
pub(super) fn refused(error: &SubmissionError) -> String {
    format!("its job cannot be rebuilt: {error}")
}
