//! References of a job to other work.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{Digest, Doubt, SimulateSpec};

/// The source of a job's trajectories: a dataset, under one of three names, or a stream.
///
/// A stored spec always has the digest or the stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DataSource {
    /// A job of the same pipeline that makes a dataset.
    Job(String),
    /// A dataset's id.
    Dataset(i64),
    /// The digest of the spec that makes the dataset.
    Digest(Digest),
    /// Robots that are simulated when they are needed and never stored. They are those that a
    /// simulation with this spec would store. A training continues past its `trajectories`, with
    /// new robots forever.
    Stream(Box<SimulateSpec>),
}

/// A source of trajectories, or a list of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum DataSources {
    /// Sources, in this order.
    Each(Vec<DataSource>),
    /// A single source.
    One(DataSource),
}

/// A checkpoint. A stored spec names it by its training's digest, which is also exact with `best`
/// or a step: the same training makes the same checkpoints.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CheckpointRef {
    /// A train job of the same pipeline. It stands for the final checkpoint.
    Job(String),
    /// A checkpoint's id.
    Checkpoint(i64),
    /// A name that stands for a checkpoint now, such as `champion`. What a stored spec names does not change when the alias
    /// moves.
    Alias(String),
    /// The digest of the training's spec. It stands for the final checkpoint.
    Digest(Digest),
    /// The checkpoint with the best validation of a training.
    Best(TrainingRef),
    /// The checkpoint of a training after this number of steps.
    Step(TrainingStep),
}

/// A training.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TrainingRef {
    /// A train job of the same pipeline.
    Job(String),
    /// The digest of its spec.
    Digest(Digest),
}

/// A checkpoint by its training and its step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainingStep {
    /// The digest of the training's spec.
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
            | Self::Alias(_)
            | Self::Digest(_)
            | Self::Best(TrainingRef::Digest(_))
            | Self::Step(_) => None,
        }
    }
}

/// The product of a job, which other jobs may refer to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Product {
    /// A dataset.
    Trajectories,
    /// Checkpoints of a model.
    Checkpoints,
}

impl Product {
    /// How to refer to it outside a pipeline.
    pub(crate) const fn names(self) -> &'static str {
        match self {
            Self::Trajectories => r#"{"dataset": ID} or {"digest": HEX}"#,
            Self::Checkpoints => {
                r#"{"checkpoint": ID}, {"digest": HEX} or {"best": {"digest": HEX}}"#
            }
        }
    }
}

/// A place in a spec that refers to other work.
#[derive(Debug)]
pub struct Reference<'a> {
    /// Its field, e.g. `checkpoints[0]`.
    pub field: String,
    /// The reference itself, which submission replaces by a digest.
    pub to: Referred<'a>,
}

/// The work that a reference names.
#[derive(Debug)]
pub enum Referred<'a> {
    /// Trajectories.
    Data(&'a mut DataSource),
    /// A checkpoint.
    Checkpoint(&'a mut CheckpointRef),
    /// A sent file, by its SHA-256.
    File(&'a mut Digest),
}

impl<'a> Reference<'a> {
    pub(crate) fn data(source: &'a mut DataSource) -> Self {
        Self { field: "data".to_owned(), to: Referred::Data(source) }
    }

    pub(crate) fn checkpoints(references: &'a mut [CheckpointRef]) -> impl Iterator<Item = Self> {
        references.iter_mut().enumerate().map(|(i, reference)| Self {
            field: format!("checkpoints[{i}]"),
            to: Referred::Checkpoint(reference),
        })
    }
}

impl Referred<'_> {
    /// The product that the reference needs. `None` for a file, because no job makes files.
    pub const fn product(&self) -> Option<Product> {
        match self {
            Self::Data(_) => Some(Product::Trajectories),
            Self::Checkpoint(_) => Some(Product::Checkpoints),
            Self::File(_) => None,
        }
    }

    /// The job of the same pipeline that it refers to.
    pub fn job(&self) -> Option<&str> {
        match self {
            Self::Data(DataSource::Job(name)) => Some(name),
            Self::Checkpoint(checkpoint) => checkpoint.job(),
            Self::Data(_) | Self::File(_) => None,
        }
    }

    /// Replaces a digest by the name of a job in the same pipeline.
    pub(crate) fn name_job(self, names: &BTreeMap<Digest, String>) {
        match self {
            Self::Data(source) => {
                if let DataSource::Digest(digest) = source
                    && let Some(name) = names.get(digest)
                {
                    *source = DataSource::Job(name.clone());
                }
            }
            Self::Checkpoint(checkpoint) => match checkpoint {
                CheckpointRef::Digest(digest) => {
                    if let Some(name) = names.get(digest) {
                        *checkpoint = CheckpointRef::Job(name.clone());
                    }
                }
                CheckpointRef::Best(training) => {
                    if let TrainingRef::Digest(digest) = training
                        && let Some(name) = names.get(digest)
                    {
                        *training = TrainingRef::Job(name.clone());
                    }
                }
                CheckpointRef::Job(_)
                | CheckpointRef::Checkpoint(_)
                | CheckpointRef::Alias(_)
                | CheckpointRef::Step(_) => {}
            },
            Self::File(_) => {}
        }
    }
}

impl From<DataSource> for DataSources {
    fn from(source: DataSource) -> Self {
        Self::One(source)
    }
}

impl DataSources {
    /// The sources, in the order of the spec.
    pub fn each(&self) -> &[DataSource] {
        match self {
            Self::One(source) => std::slice::from_ref(source),
            Self::Each(sources) => sources,
        }
    }

    /// The sources, each with its path in a spec whose field has this name, such as `data[1]`.
    pub fn in_field(&self, name: &str) -> Vec<(String, &DataSource)> {
        let path = |at: usize| match self {
            Self::One(_) => name.to_owned(),
            Self::Each(_) => format!("{name}[{at}]"),
        };
        self.each().iter().enumerate().map(|(at, source)| (path(at), source)).collect()
    }

    /// References to the sources, in the same order.
    pub(crate) fn references(&mut self, name: &str) -> Vec<Reference<'_>> {
        let fields: Vec<String> = self.in_field(name).into_iter().map(|(field, _)| field).collect();
        let sources = match self {
            Self::One(source) => std::slice::from_mut(source),
            Self::Each(sources) => sources.as_mut_slice(),
        };
        let reference = |(field, source)| Reference { field, ..Reference::data(source) };
        fields.into_iter().zip(sources).map(reference).collect()
    }
}

impl DataSource {
    /// The digest of the job that makes the dataset, of a stored spec; a stream has none.
    pub const fn digest(&self) -> Option<Digest> {
        match self {
            Self::Digest(digest) => Some(*digest),
            Self::Job(_) | Self::Dataset(_) | Self::Stream(_) => None,
        }
    }

    /// Warnings about a stream, which the field names.
    pub(crate) fn doubts(&self, field: &str) -> Vec<Doubt> {
        let Self::Stream(stream) = self else { return Vec::new() };
        let path = format!("{field}.stream");
        stream.doubts().into_iter().map(|doubt| doubt.within(&path)).collect()
    }
}
