//! A stored dataset, read as series of torques and positions.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use arrow_array::RecordBatch;
use arrow_array::cast::AsArray;
use arrow_array::types::Float32Type;
use arrow_schema::ArrowError;
use series::{Columns, MeasurementNoise, Series, Shape};
use spec::{Column, DataSource, DataSpec, Given, JobSpec};
use store::{ShardContents, ShardReader, Store};

use crate::attempt::Attempt;
use crate::error::TaskError;

/// A complete dataset. Any thread may read it.
#[derive(Clone, Debug)]
pub(crate) struct DatasetReader {
    pub spec: DataSpec,
    shards: Arc<OpenShards>,
    given: Given,
}

/// The shards of a dataset. Only the recently read ones are open, because a large dataset has more
/// shards than a process may have open files.
#[derive(Debug)]
struct OpenShards {
    store: Store,
    all: Vec<ShardContents>,
    /// Open shards with their indices, most recently read first.
    open: Mutex<VecDeque<(usize, ShardReader)>>,
}

/// Number of shards that are open at a time.
const OPEN: usize = 64;

impl OpenShards {
    /// Opens a shard unless it is open. The first time, this process checks the bytes against their
    /// digest, so that it reads what was written. Remote shards are checked when they are fetched.
    fn get(&self, place: usize) -> Result<ShardReader, TaskError> {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let known = open.iter().position(|(at, _)| *at == place);
        let reader = match known.and_then(|known| open.remove(known)) {
            Some((_, reader)) => reader,
            None => self.store.open_shard(&self.all[place])?,
        };
        open.push_front((place, reader.clone()));
        open.truncate(OPEN);
        Ok(reader)
    }
}

impl DatasetReader {
    /// Finds the dataset that a stored spec refers to.
    pub fn open(attempt: &Attempt, reference: &DataSource) -> Result<Self, TaskError> {
        let missing = |name: String| TaskError::Missing { what: "the dataset of simulation", name };
        // Submission replaced every other form of reference by a digest.
        let DataSource::Digest(digest) = reference else {
            return Err(missing(format!("{reference:?}")));
        };
        let found = attempt.wait(attempt.store.dataset_by_digest(*digest))?;
        let dataset = found.ok_or_else(|| missing(digest.to_string()))?;
        let shards = attempt.wait(attempt.store.shards(dataset.id))?;
        let job: JobSpec = serde_json::from_value(dataset.spec)?;
        let spec = DataSpec::of(&job).ok_or_else(|| missing(digest.to_string()))?;
        tracing::info!(dataset = %dataset.id, %digest, shards = shards.len(), "reads a dataset");
        let shards = OpenShards {
            store: attempt.store.clone(),
            all: shards.into_iter().map(|shard| shard.contents).collect(),
            open: Mutex::default(),
        };
        Ok(Self { spec, shards: Arc::new(shards), given: Given::Torques })
    }

    /// The same dataset with what predictors are given in the place of torques.
    pub fn given(self, given: Given) -> Self {
        Self { given, ..self }
    }

    /// Number of trajectories.
    pub fn count(&self) -> u64 {
        self.shards.all.last().map_or(0, |shard| shard.range().end)
    }

    /// The trajectories of each shard.
    pub fn shards(&self) -> Vec<Range<u64>> {
        self.shards.all.iter().map(ShardContents::range).collect()
    }

    /// The name of each trajectory's recording, of an import.
    pub fn recordings(&self) -> Result<Vec<String>, TaskError> {
        let mut names = Vec::new();
        for shard in &self.shards.all {
            let table = self.shards.store.open_table(&shard.robots)?;
            for row_group in 0..table.row_groups().count() {
                let rows = table.read_row_group(row_group, &["recording"])?;
                let column = rows.column(0).as_string_opt::<i32>();
                let not_text = || ArrowError::SchemaError("recording is not text".to_owned());
                let column = column.ok_or_else(not_text)?;
                names.extend(column.iter().map(|name| name.unwrap_or_default().to_owned()));
            }
        }
        Ok(names)
    }

    /// Number of trajectories per row group. Reading whole row groups is fastest.
    pub fn block(&self) -> u64 {
        u64::from(store::trajectories_per_row_group(self.spec.samples()))
    }

    /// Reads trajectories, in the order of their indices.
    pub fn read(&self, trajectories: Range<u64>) -> Result<Series, TaskError> {
        let blocks = self.blocks(trajectories)?;
        let robots = blocks.iter().map(Block::robots).sum();
        let mut series = self.empty(robots)?;
        for block in &blocks {
            series.gather(&block.columns()?, 0..block.robots());
        }
        Ok(series)
    }

    /// Begins to fetch the shards that hold these trajectories, unless they are files of this
    /// machine.
    pub fn fetch_ahead(&self, parts: &[Range<u64>]) {
        let Self { shards, .. } = self;
        let is_wanted = |held: &Range<u64>| {
            parts.iter().any(|part| part.start < held.end && held.start < part.end)
        };
        for shard in shards.all.iter().filter(|shard| is_wanted(&shard.range())) {
            shards.store.fetch_ahead(&shard.trajectories);
        }
    }

    /// An empty series with memory for this many trajectories.
    pub fn empty(&self, robots: usize) -> Result<Series, TaskError> {
        let noise =
            MeasurementNoise::new(self.spec.position_deviation_rad(), self.spec.torque_noise_nm());
        Ok(Series::with_capacity(self.shape(robots), self.spec.rate_hz())?.with_noise(noise))
    }

    /// The shape of this many trajectories.
    pub fn shape(&self, robots: usize) -> Shape {
        Shape { robots, samples: self.spec.samples() as usize, joints: self.spec.joints() }
    }

    /// The decoded rows of trajectories: a block per row group, in order.
    pub fn blocks(&self, trajectories: Range<u64>) -> Result<Vec<Block>, TaskError> {
        let joints = self.spec.joints();
        let observations = self.spec.observations();
        let measures = Measures {
            torques: observations.measures_torques() && self.given == Given::Torques,
            positions: observations.measures_positions(),
        };
        let mut columns: Vec<Column> = match self.given {
            Given::Torques => Column::torques(joints).collect(),
            Given::References => Column::references(joints).collect(),
        };
        columns.extend(Column::positions(joints));
        if measures.torques {
            columns.extend(Column::measured_torques(joints));
        }
        if measures.positions {
            columns.extend(Column::measured_positions(joints));
        }
        let names: Vec<String> = columns.into_iter().map(|column| column.name).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut blocks = Vec::new();
        // The shards of a complete dataset hold all its trajectories, in order.
        for (place, shard) in self.shards.all.iter().enumerate() {
            let held = shard.range();
            let part = trajectories.start.max(held.start)..trajectories.end.min(held.end);
            if !part.is_empty() {
                let samples = self.spec.samples() as usize;
                let parts = self.shards.get(place)?.read_parts(part, &names)?.into_iter();
                blocks.extend(parts.map(|(trajectories, rows)| Block {
                    trajectories,
                    samples,
                    joints,
                    measures,
                    rows,
                }));
            }
        }
        Ok(blocks)
    }
}

/// The measured values that have columns.
#[derive(Clone, Copy, Debug)]
struct Measures {
    torques: bool,
    positions: bool,
}

/// Consecutive trajectories as they were decoded. There is a column per joint: first for u, then
/// for y, then for the measured values.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    pub trajectories: Range<u64>,
    samples: usize,
    joints: usize,
    measures: Measures,
    rows: RecordBatch,
}

impl Block {
    pub fn robots(&self) -> usize {
        self.rows.num_rows() / self.samples
    }

    /// Borrows the columns, from which batches are gathered.
    pub fn columns(&self) -> Result<Columns<'_>, TaskError> {
        let columns = self.rows.columns().iter().map(|column| {
            let column = column.as_primitive_opt::<Float32Type>();
            let not_f32 = || ArrowError::SchemaError("a channel is not f32".to_owned());
            column.map(|column| &column.values()[..]).ok_or_else(not_f32)
        });
        let columns = columns.collect::<Result<Vec<&[f32]>, ArrowError>>()?;
        let mut channels = columns.chunks(self.joints.max(1)).map(<[&[f32]]>::to_vec);
        let [true_u, true_y] = [(); 2].map(|()| channels.next().unwrap_or_default());
        let Measures { torques, positions } = self.measures;
        let measured_u = if torques { channels.next() } else { None };
        let measured_y = if positions { channels.next() } else { None };
        if measured_u.is_none() && measured_y.is_none() {
            return Ok(Columns::new(self.samples, true_u, true_y)?);
        }
        let u = measured_u.unwrap_or_else(|| true_u.clone());
        let y = measured_y.unwrap_or_else(|| true_y.clone());
        Ok(Columns::new(self.samples, u, y)?.with_truth(true_u, true_y)?)
    }
}

#[cfg(test)]
mod tests {
    use arrow_array::{ArrayRef, Float32Array};

    use super::*;

    /// Two joints. Column k holds 10 k, 10 k + 1, ...
    fn block(measures: Measures) -> Block {
        let groups = 2 + usize::from(measures.torques) + usize::from(measures.positions);
        let column = |k: usize| {
            let values: Float32Array =
                (0..6_u8).map(|row| f32::from(row) + 10.0 * k as f32).collect();
            (format!("c{k}"), Arc::new(values) as ArrayRef)
        };
        let rows = RecordBatch::try_from_iter((0..2 * groups).map(column)).unwrap();
        Block { trajectories: 0..2, samples: 3, joints: 2, measures, rows }
    }

    fn gathered(measures: Measures) -> Series {
        let block = block(measures);
        let shape = Shape { robots: 2, samples: 3, joints: 2 };
        let mut series = Series::with_capacity(shape, 60.0).unwrap();
        series.gather(&block.columns().unwrap(), 0..2);
        series
    }

    #[test]
    fn predictors_get_what_was_measured_and_the_truth_lies_beside_it() {
        let first = |values: &[f32]| values[0];
        for (torques, positions, u, y) in [
            (false, false, 0.0, 20.0),
            (true, false, 40.0, 20.0),
            (false, true, 0.0, 40.0),
            (true, true, 40.0, 60.0),
        ] {
            let series = gathered(Measures { torques, positions });
            assert_eq!((first(series.u()), first(series.y())), (u, y));
            assert_eq!((first(series.true_u()), first(series.true_y())), (0.0, 20.0));
            assert_eq!(first(series.observed(2).y(1).values()), y + 3.0);
        }
    }
}
