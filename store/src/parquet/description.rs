//! `dataset.json` and `training.json`: they describe a dataset and a checkpoint to readers who have
//! only their files.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::{Column, Digest};

use crate::{FileContent, ShardContents, StoredObject};

/// Describes a dataset. It depends only on the spec and the shards, so its bytes are the same
/// wherever they were made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DatasetDescription {
    /// The name that the dataset has when the file is written.
    pub name: String,
    /// SHA-256 of the spec in canonical JSON. It identifies the dataset.
    pub digest: Digest,
    /// The version of torqued that wrote the description.
    pub version: String,
    /// Whether all shards are there.
    pub complete: bool,
    /// Number of trajectories in the shards that are there.
    pub trajectories: u64,
    /// Number of samples of each trajectory.
    pub samples: u32,
    /// Number of samples per second.
    pub rate_hz: f64,
    /// Draws that were refused while making those trajectories.
    pub rejected: u64,
    /// The columns of each kind of file.
    pub columns: TableColumns,
    /// The shards, by ordinal.
    pub shards: Vec<ShardDescription>,
    /// The job that makes the dataset again, without its execution.
    pub spec: Value,
}

/// The columns of both tables.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableColumns {
    /// Columns with one row per time step.
    pub trajectories: Vec<Column>,
    /// Columns with one row per trajectory.
    pub robots: Vec<Column>,
}

/// A shard of a dataset, with its files.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShardDescription {
    /// Its ordinal.
    pub shard: u32,
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of trajectories.
    pub trajectories: u64,
    /// Number of draws that were rejected on the way to its trajectories.
    pub rejected: u64,
    /// Its files, one of each content.
    pub files: Vec<FileDescription>,
}

/// A file of a shard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileDescription {
    /// Its name in the folder of the dataset.
    pub name: String,
    /// What its rows are.
    pub content: FileContent,
    /// Number of rows.
    pub rows: u64,
    /// In bytes.
    pub size: u64,
    /// The digest of its bytes.
    pub sha256: Digest,
}

/// Describes a checkpoint. It depends only on the training and the step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckpointDescription {
    /// SHA-256 of the training's spec in canonical JSON.
    pub digest: Digest,
    /// The version of torqued that wrote the description.
    pub version: String,
    /// Optimizer steps taken.
    pub step: u64,
    /// Whether it is the last checkpoint of its training.
    pub is_final: bool,
    /// Whether its validation is the best of its training so far.
    pub is_best: bool,
    /// Metrics of the newest validation.
    pub metrics: BTreeMap<String, f64>,
    /// The result of the training, if it ended with this checkpoint.
    pub result: Option<Value>,
    /// Its files.
    pub files: Vec<CheckpointFileDescription>,
    /// The job that makes the checkpoint again.
    pub spec: Value,
}

/// A file of a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CheckpointFileDescription {
    /// Its name in the folder of the checkpoint.
    pub name: String,
    /// In bytes.
    pub size: u64,
    /// The digest of its bytes.
    pub sha256: Digest,
}

impl CheckpointDescription {
    /// The name of the file.
    pub const FILE_NAME: &str = "training.json";

    /// The bytes of `training.json`.
    pub fn to_json(&self) -> Vec<u8> {
        // It has only strings and finite numbers, so this cannot fail.
        let mut json = serde_json::to_vec_pretty(self).expect("a description serializes to JSON");
        json.push(b'\n');
        json
    }
}

impl DatasetDescription {
    /// The name of the file.
    pub const FILE_NAME: &str = "dataset.json";

    /// The bytes of `dataset.json`.
    pub fn to_json(&self) -> Vec<u8> {
        // It has only strings and finite numbers, so this cannot fail.
        let mut json = serde_json::to_vec_pretty(self).expect("a description serializes to JSON");
        json.push(b'\n');
        json
    }
}

impl ShardDescription {
    /// Describes a shard whose trajectories have `samples` samples each.
    pub fn new(ordinal: u32, shard: &ShardContents, samples: u32) -> Self {
        let file = |(content, object): (FileContent, &StoredObject)| FileDescription {
            name: content.file_name(ordinal),
            content,
            rows: content.rows(shard.count, samples),
            size: object.size,
            sha256: object.sha256,
        };
        Self {
            shard: ordinal,
            first: shard.first,
            trajectories: shard.count,
            rejected: shard.rejected,
            files: shard.files().map(file).into(),
        }
    }

    /// The file with this content.
    pub fn file(&self, content: FileContent) -> Option<&FileDescription> {
        self.files.iter().find(|file| file.content == content)
    }
}
