//! Converts the rows of a shard into LeRobot's rows.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, ensure};
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, Int32Type, Int64Type};
use arrow_array::{Array, ArrayRef, FixedSizeListArray, Float32Array, Int64Array, RecordBatch};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::WriterProperties;
use serde_json::{Value, json};
use spec::Column;
use store::TableReader;

/// The length and the rate of episodes.
#[derive(Clone, Copy)]
pub struct Timing {
    pub samples: u32,
    pub rate_hz: f64,
}

impl Timing {
    /// The time of a frame, counted from the first frame.
    pub fn seconds(self, frame: i64) -> f32 {
        #[expect(clippy::cast_possible_truncation, reason = "the format has 32 bits")]
        let seconds = (frame as f64 / self.rate_hz) as f32;
        seconds
    }
}

/// Both features, with the statistics of their values so far.
pub struct Features {
    /// Joint positions, rad.
    pub state: Feature,
    /// Joint torques, N·m.
    pub action: Feature,
}

/// A vector of one number per joint.
pub struct Feature {
    pub key: &'static str,
    pub names: Vec<String>,
    pub unit: String,
    statistics: Vec<Statistics>,
}

/// Statistics of one joint's values.
#[derive(Clone, Copy)]
struct Statistics {
    count: u64,
    min: f64,
    max: f64,
    sum: f64,
    squares: f64,
}

impl Features {
    /// # Errors
    /// When a table has no positions and torques.
    pub fn of(columns: &[Column]) -> anyhow::Result<Self> {
        Ok(Self {
            state: Feature::of("observation.state", 'q', columns)?,
            action: Feature::of("action", 'u', columns)?,
        })
    }
}

impl Feature {
    /// The columns `u1`, `u2`, … or `q1`, `q2`, ….
    fn of(key: &'static str, symbol: char, columns: &[Column]) -> anyhow::Result<Self> {
        let is_joint = |column: &&Column| {
            let digits = column.name.strip_prefix(symbol);
            digits.is_some_and(|digits| {
                !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
            })
        };
        let columns: Vec<&Column> = columns.iter().filter(is_joint).collect();
        let unit = columns.first().and_then(|column| column.unit.as_deref());
        let unit =
            unit.with_context(|| format!("the dataset has no columns {symbol}1, {symbol}2"))?;
        let none = Statistics {
            count: 0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            sum: 0.0,
            squares: 0.0,
        };
        Ok(Self {
            key,
            unit: unit.to_owned(),
            statistics: vec![none; columns.len()],
            names: columns.iter().map(|column| column.name.to_string()).collect(),
        })
    }

    fn width(&self) -> anyhow::Result<i32> {
        i32::try_from(self.names.len()).context("too many joints")
    }

    fn field(&self) -> anyhow::Result<Field> {
        let element = Arc::new(Field::new_list_field(DataType::Float32, true));
        Ok(Field::new(self.key, DataType::FixedSizeList(element, self.width()?), false))
    }

    /// Vectors of the columns of `rows`.
    fn gather(&mut self, rows: &RecordBatch) -> anyhow::Result<ArrayRef> {
        let mut columns = Vec::new();
        for (name, statistics) in self.names.iter().zip(&mut self.statistics) {
            let column = rows.column_by_name(name).with_context(|| format!("no column {name}"))?;
            let values = values(column)?;
            values.iter().for_each(|value| statistics.add(f64::from(*value)));
            columns.push(values);
        }
        let vectors: Float32Array = (0..rows.num_rows())
            .flat_map(|row| columns.iter().map(move |column| column[row]))
            .collect();
        let element = Arc::new(Field::new_list_field(DataType::Float32, true));
        Ok(Arc::new(FixedSizeListArray::try_new(element, self.width()?, Arc::new(vectors), None)?))
    }

    /// The statistics in the form of `meta/stats.json`.
    pub fn statistics(&self) -> Value {
        let each = |of: fn(&Statistics) -> f64| self.statistics.iter().map(of).collect::<Vec<_>>();
        let count = self.statistics.first().map_or(0, |channel| channel.count);
        json!({
            "min": each(|channel| channel.min),
            "max": each(|channel| channel.max),
            "mean": each(Statistics::mean),
            "std": each(Statistics::deviation),
            "count": [count],
        })
    }
}

impl Statistics {
    fn add(&mut self, value: f64) {
        self.count += 1;
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        self.sum += value;
        self.squares += value * value;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }

    fn deviation(&self) -> f64 {
        let variance = self.squares / self.count.max(1) as f64 - self.mean().powi(2);
        variance.max(0.0).sqrt()
    }
}

/// Converts the table `from` into the data file `to`. Blocks.
///
/// # Errors
/// When a file cannot be read or written.
pub fn convert(
    from: &Path,
    to: &Path,
    timing: Timing,
    mut features: Features,
) -> anyhow::Result<Features> {
    let table = TableReader::open(from)?;
    let names: Vec<String> =
        features.state.names.iter().chain(&features.action.names).cloned().collect();
    let columns: Vec<&str> =
        ["trajectory", "step"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let number = |name: &str| Field::new(name, DataType::Int64, false);
    let schema = Arc::new(Schema::new(vec![
        features.state.field()?,
        features.action.field()?,
        Field::new("timestamp", DataType::Float32, false),
        number("frame_index"),
        number("episode_index"),
        number("index"),
        number("task_index"),
    ]));
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot create {}", folder.display()))?;
    }
    let file =
        std::fs::File::create(to).with_context(|| format!("cannot write {}", to.display()))?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .build();
    let mut writer = ArrowWriter::try_new(file, Arc::clone(&schema), Some(properties))?;
    for group in 0..table.row_groups().count() {
        let rows = table.read_row_group(group, &columns)?;
        let episodes = numbers(rows.column(0))?;
        let frames = numbers(rows.column(1))?;
        let index = episodes
            .iter()
            .zip(&frames)
            .map(|(episode, frame)| episode * i64::from(timing.samples) + frame);
        let index = Int64Array::from_iter_values(index);
        let batch = RecordBatch::try_new(
            Arc::clone(&schema),
            vec![
                features.state.gather(&rows)?,
                features.action.gather(&rows)?,
                Arc::new(
                    frames.iter().map(|frame| timing.seconds(*frame)).collect::<Float32Array>(),
                ),
                Arc::new(Int64Array::from(frames)),
                Arc::new(Int64Array::from(episodes)),
                Arc::new(index),
                Arc::new(Int64Array::from(vec![0; rows.num_rows()])),
            ],
        )?;
        writer.write(&batch)?;
    }
    writer.close()?;
    Ok(features)
}

/// The integers of a column.
fn numbers(column: &ArrayRef) -> anyhow::Result<Vec<i64>> {
    if let Some(column) = column.as_primitive_opt::<Int32Type>() {
        return Ok(column.values().iter().map(|value| i64::from(*value)).collect());
    }
    let column = column
        .as_primitive_opt::<Int64Type>()
        .context("a column has values that are not integers")?;
    Ok(column.values().to_vec())
}

/// The values of a column with 32 bits each, which LeRobot's policies need.
fn values(column: &ArrayRef) -> anyhow::Result<Vec<f32>> {
    ensure!(column.null_count() == 0, "a column has values that are missing");
    if let Some(column) = column.as_primitive_opt::<Float32Type>() {
        return Ok(column.values().to_vec());
    }
    let column = column
        .as_primitive_opt::<Float64Type>()
        .context("a column has values that are not numbers")?;
    #[expect(clippy::cast_possible_truncation, reason = "the format has 32 bits")]
    let values = column.values().iter().map(|value| *value as f32).collect();
    Ok(values)
}
