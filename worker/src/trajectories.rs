//! Trajectories as the sciences see them: series of torques and positions, stored or simulated.

use std::ops::Range;

use spec::{DataSource, DataSpec, JOINTS};

use crate::attempt::Attempt;
use crate::dataset::DatasetReader;
use crate::error::TaskError;
use crate::stream::Stream;

/// Consecutive trajectories.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Index of the first.
    pub first: u64,
    pub samples: usize,
    /// Torques `[trajectory, sample, 7]`, N·m.
    pub u: Vec<f32>,
    /// Positions `[trajectory, sample, 7]`, rad.
    pub y: Vec<f32>,
}

impl Series {
    pub fn count(&self) -> usize {
        self.u.len() / (self.samples * JOINTS)
    }

    /// Torques and positions of one trajectory, by its index in the dataset.
    pub fn trajectory(&self, index: u64) -> (&[f32], &[f32]) {
        let row = self.samples * JOINTS;
        #[expect(clippy::cast_possible_truncation, reason = "below the count of this series")]
        let start = (index - self.first) as usize * row;
        (&self.u[start..start + row], &self.y[start..start + row])
    }
}

/// Where the trajectories of a training or an evaluation come from.
#[expect(clippy::large_enum_variant, reason = "one or two exist at a time")]
#[derive(Clone, Debug)]
pub(crate) enum TrajectorySource {
    Dataset(DatasetReader),
    Stream(Stream),
}

impl TrajectorySource {
    /// Finds what a stored spec refers to.
    pub fn open(attempt: &Attempt, source: &DataSource) -> Result<Self, TaskError> {
        match source {
            DataSource::Stream(spec) => Ok(Self::Stream(Stream::new(spec))),
            DataSource::Job(_) | DataSource::Dataset(_) | DataSource::Digest(_) => {
                Ok(Self::Dataset(DatasetReader::open(attempt, source)?))
            }
        }
    }

    pub fn spec(&self) -> &DataSpec {
        match self {
            Self::Dataset(dataset) => &dataset.spec,
            Self::Stream(stream) => &stream.data,
        }
    }

    /// Trajectories in all; `None` of a stream, which has no last.
    pub fn count(&self) -> Option<u64> {
        match self {
            Self::Dataset(dataset) => Some(dataset.count()),
            Self::Stream(_) => None,
        }
    }

    /// Trajectories in the order of their indices.
    pub fn read(&self, attempt: &Attempt, range: Range<u64>) -> Result<Series, TaskError> {
        match self {
            Self::Dataset(dataset) => dataset.read(range),
            Self::Stream(stream) => stream.read(attempt, range),
        }
    }
}
