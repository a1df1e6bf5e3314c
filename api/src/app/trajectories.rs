//! Single trajectories of a dataset.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, Int32Type, Int64Type, UInt64Type};
use arrow_array::{Array, RecordBatch};
use arrow_ipc::writer::StreamWriter;
use arrow_schema::ArrowError;
use arrow_schema::{DataType, Field, Schema};
use serde_json::{Map, Value};
use spec::{Column, DataSpec, Digest};
use store::{DatasetId, STEP, Shard, StoreError, TRAJECTORY, TableReader};
use wire::{DatasetState, Trajectory};

use crate::app::App;
use crate::app::datasets::data_of;
use crate::error::ApiError;

/// A trajectory as stored in its dataset.
#[derive(Clone, Debug)]
pub struct StoredTrajectory {
    pub dataset: i64,
    /// The dataset's digest.
    pub digest: Digest,
    pub index: u64,
    pub shard: u32,
    pub rate_hz: f64,
    /// How the dataset was made.
    pub data: DataSpec,
    /// Rows with the columns that the spec asks for, one per sample.
    samples: RecordBatch,
    /// Descriptions of those columns.
    columns: Vec<Column>,
    pub robot: Map<String, Value>,
}

/// One channel of a trajectory.
pub struct Channel<'a> {
    pub column: &'a Column,
    pub values: &'a [f32],
}

/// The position of a trajectory.
struct TrajectoryLocation {
    digest: Digest,
    shard: Shard,
    spec: DataSpec,
}

impl App {
    /// # Errors
    /// When the trajectory does not exist, or its shard cannot be read.
    pub(crate) async fn trajectory(
        &self,
        dataset: i64,
        index: u64,
    ) -> Result<StoredTrajectory, ApiError> {
        let TrajectoryLocation { digest, shard, spec } = self.place(dataset, index).await?;
        let columns = spec.trajectory_columns();
        let names: Vec<String> = columns.iter().map(|column| column.name.clone()).collect();
        let first = shard.contents.first;
        let read = self.open_shards.read(&self.store, &shard, move |open| {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let samples = open.trajectories.read_trajectories(index..index + 1, &names)?;
            Ok((samples, robot(&open.robots, index - first)?))
        });
        let (samples, robot) = read.await?;
        Ok(StoredTrajectory {
            dataset,
            digest,
            index,
            shard: shard.ordinal,
            rate_hz: spec.rate_hz(),
            data: spec,
            samples,
            columns,
            robot,
        })
    }

    /// The trajectory's row in the table of robots.
    ///
    /// # Errors
    /// When the trajectory does not exist, or its shard cannot be read.
    pub(crate) async fn robot(
        &self,
        dataset: i64,
        index: u64,
    ) -> Result<Map<String, Value>, ApiError> {
        let TrajectoryLocation { shard, .. } = self.place(dataset, index).await?;
        let row = index - shard.contents.first;
        self.open_shards.read(&self.store, &shard, move |open| robot(&open.robots, row)).await
    }

    async fn place(&self, dataset: i64, index: u64) -> Result<TrajectoryLocation, ApiError> {
        let row = self.store.dataset(DatasetId(dataset)).await?;
        let shards = self.store.shards(row.id).await?;
        let holds = |shard: &&Shard| shard.contents.range().contains(&index);
        let Some(shard) = shards.iter().find(holds).cloned() else {
            let there = available_ranges(row.state, row.trajectories, &shards);
            let id = format!("{index} in dataset {dataset}: {there}");
            return Err(ApiError::not_found("trajectory", id));
        };
        let spec = data_of(&row.spec).ok_or_else(|| {
            let reason = "its spec is of another version of torqued".to_owned();
            ApiError::ShardUnreadable { dataset, shard: shard.ordinal, reason }
        })?;
        Ok(TrajectoryLocation { digest: row.digest, shard, spec })
    }
}

/// A sentence about the trajectories that exist.
fn available_ranges(state: DatasetState, trajectories: u64, shards: &[Shard]) -> String {
    match (state, shards) {
        (DatasetState::Complete, _) => format!("there are 0 to {}", trajectories.saturating_sub(1)),
        (_, []) => "no shard is finished yet".to_owned(),
        (DatasetState::Building | DatasetState::Abandoned, shards) => {
            let ranges: Vec<Range<u64>> =
                shards.iter().map(|shard| shard.contents.range()).collect();
            let ranges: Vec<String> = ranges
                .chunk_by(|a, b| a.end == b.start)
                .map(|run| format!("{} to {}", run[0].start, run[run.len() - 1].end - 1))
                .collect();
            format!("the finished shards have {}", ranges.join(", "))
        }
    }
}

/// A row of the table of robots.
fn robot(table: &TableReader, row: u64) -> Result<Map<String, Value>, StoreError> {
    let mut before = 0;
    for (group, rows) in table.row_groups().enumerate() {
        if row < before + rows {
            let batch = table.read_row_group(group, &table.columns())?;
            let row = usize::try_from(row - before).unwrap_or(usize::MAX);
            return Ok(row_of(&batch, row));
        }
        before += rows;
    }
    Ok(Map::new())
}

fn row_of(batch: &RecordBatch, row: usize) -> Map<String, Value> {
    let schema = batch.schema();
    let cells = schema.fields().iter().zip(batch.columns());
    cells.map(|(field, values)| (field.name().clone(), cell(values, row))).collect()
}

/// The value of a cell as JSON; null if there is none, or if it is not a finite number.
fn cell(values: &dyn Array, row: usize) -> Value {
    if row >= values.len() || values.is_null(row) {
        return Value::Null;
    }
    match values.data_type() {
        DataType::Boolean => values.as_boolean().value(row).into(),
        DataType::Int32 => values.as_primitive::<Int32Type>().value(row).into(),
        DataType::Int64 => values.as_primitive::<Int64Type>().value(row).into(),
        DataType::UInt64 => values.as_primitive::<UInt64Type>().value(row).into(),
        DataType::Float32 => values.as_primitive::<Float32Type>().value(row).into(),
        DataType::Float64 => values.as_primitive::<Float64Type>().value(row).into(),
        DataType::Utf8 => values.as_string::<i32>().value(row).into(),
        _ => Value::Null,
    }
}

impl StoredTrajectory {
    /// The channels, without the two columns of indices.
    pub fn channels(&self) -> impl Iterator<Item = Channel<'_>> {
        let columns = self.columns.iter().zip(self.samples.columns());
        columns.filter_map(|(column, values)| {
            let values = values.as_primitive_opt::<Float32Type>()?;
            let is_number = [TRAJECTORY, STEP].contains(&column.name.as_str());
            (!is_number).then(|| Channel { column, values: values.values() })
        })
    }

    /// The values of the channel with this name.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels().find(|channel| channel.column.name == name).map(|found| found.values)
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.samples.num_rows()
    }

    /// The time of each sample, s.
    pub fn times(&self) -> impl Iterator<Item = f64> {
        (0u32..).map(|step| f64::from(step) / self.rate_hz).take(self.samples.num_rows())
    }

    pub fn to_resource(&self) -> Trajectory {
        let units = self.channels().filter_map(|channel| {
            Some((channel.column.name.clone(), channel.column.unit.clone()?))
        });
        let finite = |value: &f32| Some(*value).filter(|value| value.is_finite());
        let columns = self.channels().map(|channel| {
            (channel.column.name.clone(), channel.values.iter().map(finite).collect())
        });
        Trajectory {
            dataset: self.dataset,
            trajectory: self.index,
            shard: self.shard,
            rate_hz: self.rate_hz,
            samples: self.samples.num_rows() as u64,
            time_s: self.times().collect(),
            columns: columns.collect(),
            units: units.collect(),
            robot: self.robot.clone(),
        }
    }

    /// An Arrow IPC stream of the samples. Fields have their units, and the schema has dataset,
    /// trajectory, rate and robot.
    ///
    /// # Errors
    /// When arrow cannot write it.
    pub fn to_arrow(&self) -> Result<Vec<u8>, ArrowError> {
        let fields: Vec<Field> = self
            .samples
            .schema_ref()
            .fields()
            .iter()
            .zip(&self.columns)
            .map(|(field, column)| {
                let unit = column.unit.clone().map(|unit| ("unit".to_owned(), unit));
                field.as_ref().clone().with_metadata(unit.into_iter().collect::<HashMap<_, _>>())
            })
            .collect();
        let metadata = [
            ("torqued.dataset", self.dataset.to_string()),
            ("torqued.trajectory", self.index.to_string()),
            ("torqued.rate_hz", self.rate_hz.to_string()),
            ("torqued.robot", Value::from(self.robot.clone()).to_string()),
        ];
        let metadata = HashMap::from(metadata.map(|(key, value)| (key.to_owned(), value)));
        let schema = Arc::new(Schema::new_with_metadata(fields, metadata));
        let samples = self.samples.clone().with_schema(Arc::clone(&schema))?;
        let mut writer = StreamWriter::try_new(Vec::new(), &schema)?;
        writer.write(&samples)?;
        writer.into_inner()
    }

    /// CSV with one line per sample: its time, then every channel. The header has names and units.
    pub fn to_csv(&self) -> String {
        let channels: Vec<Channel<'_>> = self.channels().collect();
        let mut text = "time_s".to_owned();
        for Channel { column, .. } in &channels {
            let unit = column.unit.as_ref().map(|unit| format!(" ({unit})"));
            text.push_str(&format!(",{}{}", column.name, unit.unwrap_or_default()));
        }
        for (step, time) in self.times().enumerate() {
            text.push_str(&format!("\n{time}"));
            for Channel { values, .. } in &channels {
                text.push_str(&format!(",{}", values[step]));
            }
        }
        text.push('\n');
        text
    }
}
