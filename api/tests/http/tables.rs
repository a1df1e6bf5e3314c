//! Tables of shards in which every value follows from its place.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use arrow_array::{
    ArrayRef, BooleanArray, Float32Array, Float64Array, Int32Array, Int64Array, RecordBatch,
    StringArray,
};
use spec::{Column, ColumnType, DataSpec};
use store::{ChannelSummary, ClaimedTask, FileContent, ShardSummary, Spectrum, Store, object_path};
use store::{StoredObject, TableWriter, table_schema};

/// The value in the column at `position` for `trajectory` at `step`.
#[expect(clippy::cast_precision_loss, reason = "small numbers")]
pub fn value(position: usize, trajectory: u64, step: u64) -> f64 {
    position as f64 + 10.0 * trajectory as f64 + step as f64 / 64.0
}

/// Writes a table of the shard that `task` makes, with `trajectories`.
pub async fn write(
    store: &Store,
    task: &ClaimedTask,
    data: &DataSpec,
    trajectories: Range<u64>,
    content: FileContent,
) -> StoredObject {
    let (columns, samples) = match content {
        FileContent::Trajectories => (data.trajectory_columns(), u64::from(data.samples())),
        FileContent::Robots => (data.table_columns(), 1),
    };
    let rows: Vec<(u64, u64)> = trajectories
        .flat_map(|trajectory| (0..samples).map(move |step| (trajectory, step)))
        .collect();
    let arrays = columns.iter().enumerate().map(|(i, column)| array(i, column, &rows)).collect();
    let schema = table_schema(&columns);
    let batch = RecordBatch::try_new(Arc::clone(&schema), arrays).unwrap();
    let path = object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
    let footer = BTreeMap::new();
    let mut table = match content {
        FileContent::Trajectories => {
            let object = store.write_object(&path).await.unwrap();
            TableWriter::trajectories(object, schema, data.samples(), &footer).unwrap()
        }
        FileContent::Robots => store.write_table(&path, schema, &footer).await.unwrap(),
    };
    let write = move || {
        table.write(batch).unwrap();
        table.finish().unwrap()
    };
    tokio::task::spawn_blocking(write).await.unwrap()
}

#[expect(clippy::cast_possible_truncation, reason = "the values fit")]
fn array(position: usize, column: &Column, rows: &[(u64, u64)]) -> ArrayRef {
    let number = |&(trajectory, step): &(u64, u64)| match column.name.as_str() {
        "trajectory" => trajectory as f64,
        "step" => step as f64,
        _ => value(position, trajectory, step),
    };
    let values = rows.iter().map(number);
    match column.data_type {
        ColumnType::Boolean => Arc::new(BooleanArray::from(vec![true; rows.len()])),
        ColumnType::Int32 => {
            Arc::new(Int32Array::from_iter_values(values.map(|value| value as i32)))
        }
        ColumnType::Int64 => {
            Arc::new(Int64Array::from_iter_values(values.map(|value| value as i64)))
        }
        ColumnType::Float32 => {
            Arc::new(Float32Array::from_iter_values(values.map(|value| value as f32)))
        }
        ColumnType::Float64 if column.nullable => Arc::new(Float64Array::new_null(rows.len())),
        ColumnType::Float64 => Arc::new(Float64Array::from_iter_values(values)),
        ColumnType::Text => Arc::new(StringArray::from(vec!["multisine"; rows.len()])),
    }
}

/// The summary of a shard with this many trajectories.
pub fn summary(data: &DataSpec, trajectories: u64, rejected: u64) -> ShardSummary {
    let channels = data.trajectory_columns().into_iter().skip(2).map(|column| ChannelSummary {
        name: column.name,
        min: -0.5,
        max: 1.5,
        mean: 0.25,
        std: 0.125,
    });
    let parameters = [("mass_1", 2.5), ("mass_2", 3.5), ("payload_mass", 1.5)];
    let arms = parameters.map(|(name, mean)| ChannelSummary {
        name: name.to_owned(),
        min: 0.0,
        max: 2.0 * mean,
        mean,
        std: 0.125,
    });
    let spectrum = |signal: &str, joint: Option<u32>| Spectrum {
        signal: signal.to_owned(),
        joint,
        trajectories,
        step_hz: 0.15,
        density: vec![0.0, 4.0, 2.0, 1.0],
    };
    ShardSummary {
        trajectories,
        samples: trajectories * u64::from(data.samples()),
        rejected,
        channels: channels.collect(),
        spectra: vec![spectrum("u", None), spectrum("q", None), spectrum("q", Some(2))],
        arms: arms.into(),
    }
}
