use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::Digest;

/// A dataset, by one of three names; a stored spec always has the digest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DatasetRef {
    /// A simulate job of the same pipeline.
    Job(String),
    /// A dataset's id.
    Dataset(i64),
    /// The digest of the spec that produces it.
    Digest(Digest),
}

/// A checkpoint, by one of three names; a stored spec always has the digest.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CheckpointRef {
    /// A train job of the same pipeline: its last checkpoint.
    Job(String),
    /// A checkpoint's id; stands for the last checkpoint of the same training.
    Checkpoint(i64),
    /// The digest of the training's spec: its last checkpoint.
    Digest(Digest),
}
