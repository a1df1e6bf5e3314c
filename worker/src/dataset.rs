//! A dataset as the sciences see it: series of torques and positions.

use std::ops::Range;

use arrow::array::{Array, Float32Array, RecordBatch};
use arrow::error::ArrowError;
use spec::{DatasetRef, JOINTS, SimulateSpec};
use store::{Shard, Store};

use crate::attempt::{Attempt, read_spec};
use crate::error::TaskError;
use crate::simulate::{POSITIONS, TORQUES};

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

/// A complete dataset, open for reading from any thread.
#[derive(Clone, Debug)]
pub(crate) struct DatasetReader {
    store: Store,
    pub spec: SimulateSpec,
    shards: Vec<Shard>,
}

impl DatasetReader {
    /// Finds the dataset that a stored spec refers to.
    pub fn open(attempt: &Attempt, reference: &DatasetRef) -> Result<Self, TaskError> {
        let missing = |name: String| TaskError::Missing { what: "the dataset of simulation", name };
        // Submission turned every other form of reference into a digest.
        let DatasetRef::Digest(digest) = reference else {
            return Err(missing(format!("{reference:?}")));
        };
        let found = attempt.wait(attempt.store.dataset_by_digest(*digest))?;
        let dataset = found.ok_or_else(|| missing(digest.to_string()))?;
        let shards = attempt.wait(attempt.store.shards(dataset.id))?;
        Ok(Self { store: attempt.store.clone(), spec: read_spec(&dataset.spec)?, shards })
    }

    /// The trajectories of each shard.
    pub fn shards(&self) -> Vec<Range<u64>> {
        self.shards.iter().map(|shard| shard.first..shard.first + shard.count).collect()
    }

    /// Trajectories per row group: what is fastest to read at once.
    pub fn block(&self) -> u64 {
        u64::from(store::trajectories_per_row_group(self.spec.samples))
    }

    pub fn read(&self, trajectories: Range<u64>) -> Result<Series, TaskError> {
        let columns: Vec<&str> = TORQUES.into_iter().chain(POSITIONS).collect();
        let first = trajectories.start;
        let batch = self.store.read_trajectories(&self.shards, trajectories, &columns)?;
        Ok(Series {
            first,
            samples: self.spec.samples as usize,
            u: interleave(&batch, 0)?,
            y: interleave(&batch, JOINTS)?,
        })
    }
}

/// Seven columns from `first` on as `[.., 7]`.
fn interleave(batch: &RecordBatch, first: usize) -> Result<Vec<f32>, ArrowError> {
    let mut series = vec![0.0; batch.num_rows() * JOINTS];
    for joint in 0..JOINTS {
        let column = batch.column(first + joint).as_any().downcast_ref::<Float32Array>();
        let column = column.ok_or_else(|| {
            ArrowError::SchemaError(format!("column {} is not f32", first + joint))
        })?;
        for (sample, value) in series.as_chunks_mut::<JOINTS>().0.iter_mut().zip(column.values()) {
            sample[joint] = *value;
        }
    }
    Ok(series)
}
