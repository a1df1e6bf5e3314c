//! The two tables of an imported dataset, several trajectories at a time.

use std::collections::VecDeque;
use std::sync::Arc;

use arrow_array::{
    ArrayRef, Float32Array, Float64Array, Int32Array, Int64Array, RecordBatch, StringArray,
};
use arrow_schema::ArrowError;
use arrow_schema::SchemaRef;

use crate::samples::Sample;

/// Consecutive trajectories of the dataset.
#[derive(Debug)]
pub struct ImportedTrajectories {
    /// Rows with the columns of [`spec::ImportSpec::trajectory_columns`].
    pub samples: RecordBatch,
    /// Rows with the columns of [`spec::ImportSpec::table_columns`].
    pub table: RecordBatch,
}

/// The schemas of both tables.
#[derive(Clone, Debug)]
pub struct TableSchemas {
    /// The schema of [`ImportedTrajectories::samples`].
    pub samples: SchemaRef,
    /// The schema of [`ImportedTrajectories::table`].
    pub table: SchemaRef,
}

/// Collects trajectories for the tables.
pub(crate) struct Tables {
    schemas: TableSchemas,
    next: u64,
    trajectory: Vec<i32>,
    step: Vec<i32>,
    channels: Vec<Vec<f32>>,
    indices: Vec<i32>,
    recordings: Vec<String>,
    first_times_s: Vec<f64>,
    first_rows: Vec<i64>,
}

/// The origin of a trajectory.
pub(crate) struct Origin<'a> {
    /// Empty if the file names no recordings.
    pub recording: &'a str,
    pub first_time_s: f64,
    pub first_row: u64,
}

/// Number of rows of samples after which they are handed on.
const FULL: usize = 50_000;

impl Tables {
    pub fn new(schemas: TableSchemas, channels: usize) -> Self {
        Self {
            schemas,
            next: 0,
            trajectory: Vec::new(),
            step: Vec::new(),
            channels: vec![Vec::new(); channels],
            indices: Vec::new(),
            recordings: Vec::new(),
            first_times_s: Vec::new(),
            first_rows: Vec::new(),
        }
    }

    /// Number of trajectories so far.
    pub const fn count(&self) -> u64 {
        self.next
    }

    pub fn is_full(&self) -> bool {
        self.step.len() >= FULL
    }

    /// # Errors
    /// When there are more trajectories than the index can count.
    pub fn push(
        &mut self,
        samples: &VecDeque<Sample>,
        origin: &Origin<'_>,
    ) -> Result<(), ArrowError> {
        let index = count(self.next)?;
        for step in 0..samples.len() as u64 {
            self.step.push(count(step)?);
        }
        self.trajectory.resize(self.step.len(), index);
        for (channel, values) in self.channels.iter_mut().enumerate() {
            values.extend(samples.iter().map(|sample| narrow(sample.values[channel])));
        }
        self.indices.push(index);
        self.recordings.push(origin.recording.to_owned());
        self.first_times_s.push(origin.first_time_s);
        self.first_rows.push(i64::try_from(origin.first_row).unwrap_or(i64::MAX));
        self.next += 1;
        Ok(())
    }

    /// Takes the collected trajectories.
    pub fn take(&mut self) -> Result<ImportedTrajectories, ArrowError> {
        let ids = [&mut self.trajectory, &mut self.step];
        let ids = ids.map(|ids| Arc::new(Int32Array::from(std::mem::take(ids))) as ArrayRef);
        let channels = self.channels.iter_mut();
        let channels =
            channels.map(|values| Arc::new(Float32Array::from(std::mem::take(values))) as ArrayRef);
        let samples = ids.into_iter().chain(channels).collect();
        let table: Vec<ArrayRef> = vec![
            Arc::new(Int32Array::from(std::mem::take(&mut self.indices))),
            Arc::new(StringArray::from(std::mem::take(&mut self.recordings))),
            Arc::new(Float64Array::from(std::mem::take(&mut self.first_times_s))),
            Arc::new(Int64Array::from(std::mem::take(&mut self.first_rows))),
        ];
        Ok(ImportedTrajectories {
            samples: RecordBatch::try_new(Arc::clone(&self.schemas.samples), samples)?,
            table: RecordBatch::try_new(Arc::clone(&self.schemas.table), table)?,
        })
    }
}

fn count(value: u64) -> Result<i32, ArrowError> {
    i32::try_from(value).map_err(|_| ArrowError::ArithmeticOverflow(format!("index {value}")))
}

#[expect(clippy::cast_possible_truncation, reason = "the dataset has f32; ranges keep it finite")]
const fn narrow(value: f64) -> f32 {
    value as f32
}
