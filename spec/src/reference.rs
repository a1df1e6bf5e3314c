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

/// A checkpoint. A stored spec names it by its training's digest, which with `best` or a step is
/// exact too: the same training makes the same checkpoints.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CheckpointRef {
    /// A train job of the same pipeline: its final checkpoint.
    Job(String),
    /// A checkpoint's id.
    Checkpoint(i64),
    /// The digest of the training's spec: its final checkpoint.
    Digest(Digest),
    /// The checkpoint of the best validation of a training.
    Best(TrainingRef),
    /// The checkpoint of a training after so many steps.
    Step(TrainingStep),
}

/// A training.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TrainingRef {
    /// A train job of the same pipeline.
    Job(String),
    /// The digest of its spec.
    Digest(Digest),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainingStep {
    /// Of the training's spec.
    pub digest: Digest,
    /// Optimizer steps taken.
    pub step: u64,
}

impl CheckpointRef {
    /// The job of the same pipeline that makes it.
    pub fn job(&self) -> Option<&str> {
        match self {
            Self::Job(name) | Self::Best(TrainingRef::Job(name)) => Some(name),
            Self::Checkpoint(_)
            | Self::Digest(_)
            | Self::Best(TrainingRef::Digest(_))
            | Self::Step(_) => None,
        }
    }
}
