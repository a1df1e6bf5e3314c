//! The trajectories of a training or an evaluation, stored or simulated.

use std::ops::Range;

use series::Series;
use spec::{DataSource, DataSpec, Given};

use crate::attempt::Attempt;
use crate::dataset::DatasetReader;
use crate::error::TaskError;
use crate::stream::Stream;

#[expect(clippy::large_enum_variant, reason = "one or two exist at a time")]
#[derive(Clone, Debug)]
pub(crate) enum TrajectorySource {
    Dataset(DatasetReader),
    Stream(Stream),
}

impl TrajectorySource {
    /// Opens the data that a stored spec refers to. Its series have what predictors are `given` in
    /// the place of torques.
    pub fn open(attempt: &Attempt, source: &DataSource, given: Given) -> Result<Self, TaskError> {
        match source {
            DataSource::Stream(spec) => {
                tracing::info!(seed = spec.seed, samples = spec.samples, "simulates its data");
                Ok(Self::Stream(Stream::new(spec).given(given)))
            }
            DataSource::Job(_) | DataSource::Dataset(_) | DataSource::Digest(_) => {
                Ok(Self::Dataset(DatasetReader::open(attempt, source)?.given(given)))
            }
        }
    }

    pub fn spec(&self) -> &DataSpec {
        match self {
            Self::Dataset(dataset) => &dataset.spec,
            Self::Stream(stream) => &stream.data,
        }
    }

    /// Number of trajectories; `None` for a stream, which has no end.
    pub fn count(&self) -> Option<u64> {
        match self {
            Self::Dataset(dataset) => Some(dataset.count()),
            Self::Stream(_) => None,
        }
    }

    /// Reads trajectories, in the order of their indices.
    pub fn read(&self, attempt: &Attempt, range: Range<u64>) -> Result<Series, TaskError> {
        match self {
            Self::Dataset(dataset) => dataset.read(range),
            Self::Stream(stream) => stream.read(attempt, range),
        }
    }
}
