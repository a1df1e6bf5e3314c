//! A stored dataset, read as series of torques and positions.

use std::ops::Range;

use arrow::array::{AsArray, RecordBatch};
use arrow::datatypes::Float32Type;
use arrow::error::ArrowError;
use series::{Columns, Series, Shape};
use spec::{Column, DataSource, DataSpec, JobSpec};
use store::ShardReader;

use crate::attempt::Attempt;
use crate::error::TaskError;

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
            let reader = attempt.store.open_shard(&shard.contents)?;
            shards.push((shard.contents.range(), reader));
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
        let blocks = self.blocks(trajectories)?;
        let robots = blocks.iter().map(Block::robots).sum();
        let mut series = Series::with_capacity(self.shape(robots), self.spec.rate_hz())?;
        for block in &blocks {
            series.gather(&block.columns()?, 0..block.robots());
        }
        Ok(series)
    }

    /// The shape of so many trajectories.
    pub fn shape(&self, robots: usize) -> Shape {
        Shape { robots, samples: self.spec.samples() as usize, joints: self.spec.joints() }
    }

    /// The rows of trajectories within the dataset, decoded: a block per row group, in order.
    pub fn blocks(&self, trajectories: Range<u64>) -> Result<Vec<Block>, TaskError> {
        let joints = self.spec.joints();
        let columns = Column::torques(joints).chain(Column::positions(joints));
        let names: Vec<String> = columns.map(|column| column.name).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut blocks = Vec::new();
        // The shards of a complete dataset hold all its trajectories, in order.
        for (held, reader) in &self.shards {
            let part = trajectories.start.max(held.start)..trajectories.end.min(held.end);
            if !part.is_empty() {
                let samples = self.spec.samples() as usize;
                let parts = reader.read_parts(part, &names)?.into_iter();
                blocks.extend(parts.map(|(trajectories, rows)| Block {
                    trajectories,
                    samples,
                    rows,
                }));
            }
        }
        Ok(blocks)
    }
}

/// Consecutive trajectories as they were decoded: a column per joint, first of u, then of y.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    pub trajectories: Range<u64>,
    samples: usize,
    rows: RecordBatch,
}

impl Block {
    pub fn robots(&self) -> usize {
        self.rows.num_rows() / self.samples
    }

    /// Borrows the columns, from which batches are gathered.
    pub fn columns(&self) -> Result<Columns<'_>, TaskError> {
        let mut columns = self.rows.columns().iter().map(|column| {
            let column = column.as_primitive_opt::<Float32Type>();
            let not_f32 = || ArrowError::SchemaError("a channel is not f32".to_owned());
            column.map(|column| &column.values()[..]).ok_or_else(not_f32)
        });
        let joints = self.rows.num_columns() / 2;
        let u = columns.by_ref().take(joints).collect::<Result<_, _>>()?;
        let y = columns.collect::<Result<_, _>>()?;
        Ok(Columns::new(self.samples, u, y)?)
    }
}
