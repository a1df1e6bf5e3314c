use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{Digest, SimulateSpec};

/// Where a job's trajectories come from: a dataset, by one of three names, or a stream.
///
/// A stored spec always has the digest or the stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DataSource {
    /// A simulate job of the same pipeline.
    Job(String),
    /// A dataset's id.
    Dataset(i64),
    /// The digest of the spec that produces it.
    Digest(Digest),
    /// Robots simulated when they are needed and never stored: what the simulation with this spec
    /// would hold. A training goes on past its `trajectories`, with new robots forever.
    Stream(Box<SimulateSpec>),
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
