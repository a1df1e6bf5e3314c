//! A stored dataset, read as series of torques and positions.

use std::ops::Range;

use arrow::array::{Array, Float32Array, RecordBatch};
use arrow::error::ArrowError;
use spec::{DataSource, DataSpec, JOINTS, JobSpec};
use store::ShardReader;

use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::simulate::{POSITIONS, TORQUES};
use crate::trajectories::Series;

/// A complete dataset, open for reading from any thread.
#[derive(Clone, Debug)]
pub(crate) struct DatasetReader {
    pub spec: DataSpec,
    /// By the trajectories each holds.
    shards: Vec<(Range<u64>, ShardReader)>,
}

impl DatasetReader {
    /// Finds the dataset that a stored spec refers to.
    pub fn open(attempt: &Attempt, reference: &DataSource) -> Result<Self, TaskError> {
        let missing = |name: String| TaskError::Missing { what: "the dataset of simulation", name };
        // Submission turned every other form of reference into a digest.
        let DataSource::Digest(digest) = reference else {
            return Err(missing(format!("{reference:?}")));
        };
        let found = attempt.wait(attempt.store.dataset_by_digest(*digest))?;
        let dataset = found.ok_or_else(|| missing(digest.to_string()))?;
        let mut shards = Vec::new();
        for shard in attempt.wait(attempt.store.shards(dataset.id))? {
            attempt.check_stop()?;
            // Checks the bytes against their digest, so that what is read below is what was written.
            let reader = attempt.store.open_shard(&shard)?;
            shards.push((shard.first..shard.first + shard.count, reader));
        }
        let job: JobSpec = serde_json::from_value(dataset.spec)?;
        let spec = DataSpec::of(&job).ok_or_else(|| missing(digest.to_string()))?;
        Ok(Self { spec, shards })
    }

    /// Trajectories in all.
    pub fn count(&self) -> u64 {
        self.shards.last().map_or(0, |(trajectories, _)| trajectories.end)
    }

    /// The trajectories of each shard.
    pub fn shards(&self) -> Vec<Range<u64>> {
        self.shards.iter().map(|(trajectories, _)| trajectories.clone()).collect()
    }

    /// Trajectories per row group: what is fastest to read at once.
    pub fn block(&self) -> u64 {
        u64::from(store::trajectories_per_row_group(self.spec.samples()))
    }

    /// Trajectories within the dataset, in the order of their indices.
    pub fn read(&self, trajectories: Range<u64>) -> Result<Series, TaskError> {
        let columns: Vec<&str> = TORQUES.into_iter().chain(POSITIONS).collect();
        let mut series = Series {
            first: trajectories.start,
            samples: self.spec.samples() as usize,
            u: Vec::new(),
            y: Vec::new(),
        };
        // The shards of a complete dataset hold all its trajectories, in order.
        for (held, reader) in &self.shards {
            let part = trajectories.start.max(held.start)..trajectories.end.min(held.end);
            if !part.is_empty() {
                let batch = reader.read_trajectories(part, &columns)?;
                interleave(&batch, 0, &mut series.u)?;
                interleave(&batch, JOINTS, &mut series.y)?;
            }
        }
        Ok(series)
    }
}

/// Appends seven columns from `first` on, as `[.., 7]`.
fn interleave(batch: &RecordBatch, first: usize, series: &mut Vec<f32>) -> Result<(), ArrowError> {
    /// Samples at once: seven passes over all of a column would not stay in the cache.
    const BLOCK: usize = 512;
    let mut columns = [&[][..]; JOINTS];
    for (joint, column) in columns.iter_mut().enumerate() {
        let array = batch.column(first + joint).as_any().downcast_ref::<Float32Array>();
        let not_f32 = || ArrowError::SchemaError(format!("column {} is not f32", first + joint));
        *column = array.ok_or_else(not_f32)?.values();
    }
    let start = series.len();
    series.resize(start + batch.num_rows() * JOINTS, 0.0);
    let samples = series[start..].as_chunks_mut::<JOINTS>().0;
    for (block, samples) in samples.chunks_mut(BLOCK).enumerate() {
        for (joint, column) in columns.iter().enumerate() {
            for (sample, value) in samples.iter_mut().zip(&column[block * BLOCK..]) {
                sample[joint] = *value;
            }
        }
    }
    Ok(())
}
