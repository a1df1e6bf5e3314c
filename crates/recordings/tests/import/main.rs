//! Imports of good and bad files from different writers.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod csv;
mod decoder;
mod files;
mod fuzz;
mod limits;
mod mcap;
mod motion;
mod npz;
mod parquet;
mod tables;

use std::sync::Arc;

use ::parquet::arrow::ArrowWriter;
use ::parquet::file::properties::WriterProperties;
use arrow_array::{ArrayRef, Float32Array, Float64Array, Int32Array, RecordBatch, StringArray};
use arrow_select::concat::concat_batches;
use recordings::{Conversion, ImportError, Rows, TableSchemas};
use serde_json::{Value, json};
use spec::{ImportSpec, JobSpec};
use wire::ImportCounts;

/// Recordings of a moving arm, as one table.
#[derive(Clone)]
struct Recordings {
    names: Vec<String>,
    times: Vec<f64>,
    /// Torques, then positions: `[14][row]`.
    channels: Vec<Vec<f64>>,
}

impl Recordings {
    /// One recording per length, at 60 Hz.
    fn of(lengths: &[usize]) -> Self {
        let mut recordings =
            Self { names: Vec::new(), times: Vec::new(), channels: vec![Vec::new(); 14] };
        for (number, length) in lengths.iter().enumerate() {
            for k in 0..*length {
                let time = k as f64 / 60.0;
                recordings.names.push(format!("arm {number}"));
                recordings.times.push(time);
                for (channel, values) in recordings.channels.iter_mut().enumerate() {
                    let phase = (channel + number) as f64;
                    values.push(f64::from(narrow((time * 3.0 + phase).sin())));
                }
            }
        }
        recordings
    }

    fn columns(&self) -> Vec<(String, ArrayRef)> {
        let mut columns: Vec<(String, ArrayRef)> = vec![
            ("arm".to_owned(), Arc::new(StringArray::from(self.names.clone()))),
            ("t".to_owned(), Arc::new(Float64Array::from(self.times.clone()))),
        ];
        for (name, values) in channel_names().into_iter().zip(&self.channels) {
            let values: Float32Array = values.iter().map(|value| Some(narrow(*value))).collect();
            columns.push((name, Arc::new(values)));
        }
        columns
    }

    fn parquet(&self, properties: WriterProperties) -> Vec<u8> {
        parquet_of(self.columns(), properties)
    }

    fn csv(&self) -> String {
        let mut text = format!("arm,t,{}\n", channel_names().join(","));
        for (row, (name, time)) in self.names.iter().zip(&self.times).enumerate() {
            let values = self.channels.iter().map(|values| values[row].to_string());
            let values: Vec<String> = values.collect();
            text.push_str(&format!("{name},{time},{}\n", values.join(",")));
        }
        text
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the columns are f32")]
fn narrow(value: f64) -> f32 {
    value as f32
}

fn channel_names() -> Vec<String> {
    let of = |prefix: &'static str| (1..=7).map(move |joint| format!("{prefix}{joint}"));
    of("tau_").chain(of("pos_")).collect()
}

fn parquet_of(columns: Vec<(String, ArrayRef)>, properties: WriterProperties) -> Vec<u8> {
    let batch = RecordBatch::try_from_iter(columns).unwrap();
    let mut bytes = Vec::new();
    let mut writer = ArrowWriter::try_new(&mut bytes, batch.schema(), Some(properties)).unwrap();
    writer.write(&batch).unwrap();
    writer.close().unwrap();
    bytes
}

fn small_pages() -> WriterProperties {
    WriterProperties::builder()
        .set_max_row_group_row_count(Some(50))
        .set_data_page_row_count_limit(16)
        .set_write_batch_size(16)
        .build()
}

/// A spec for [`Recordings`], with trajectories of 40 samples unless `fields` change it.
fn spec(format: &str, fields: &Value) -> ImportSpec {
    let names = channel_names();
    let mut spec = json!({
        "kind": "import", "file": "0".repeat(64), "format": format, "samples": 40,
        "columns": {"time": "t", "recording": "arm", "u": names[..7], "q": names[7..]},
    });
    for (field, value) in fields.as_object().unwrap() {
        spec[field] = value.clone();
    }
    match ::spec::parse(spec.to_string().as_bytes()).unwrap() {
        JobSpec::Import(spec) => spec,
        other => panic!("{other:?}"),
    }
}

/// The result of importing a file.
struct Imported {
    samples: RecordBatch,
    table: RecordBatch,
    counts: ImportCounts,
    /// Number of rows of samples in each part that was handed on.
    parts: Vec<usize>,
}

fn conversion<I>(rows: I, spec: &ImportSpec) -> Conversion<I>
where
    I: Iterator<Item = Result<Rows, ImportError>>,
{
    let schemas = TableSchemas {
        samples: store::table_schema(&spec.trajectory_columns()),
        table: store::table_schema(&spec.table_columns()),
    };
    Conversion::new(rows, spec, schemas)
}

/// The trajectories of rows, or the error with all its causes.
fn convert(
    rows: impl Iterator<Item = Result<Rows, ImportError>>,
    spec: &ImportSpec,
) -> Result<Imported, ImportError> {
    let mut conversion = conversion(rows, spec);
    let (mut samples, mut table) = (Vec::new(), Vec::new());
    while let Some(imported) = conversion.next_trajectories()? {
        samples.push(imported.samples);
        table.push(imported.table);
    }
    let counts = conversion.finish()?;
    let whole = |parts: &[RecordBatch]| concat_batches(&parts[0].schema(), parts).unwrap();
    let parts = samples.iter().map(RecordBatch::num_rows).collect();
    Ok(Imported { samples: whole(&samples), table: whole(&table), counts, parts })
}

/// The trajectories of a file, or the error. The file is decoded by a process that stays for the
/// next file.
fn import(file: impl Into<Vec<u8>>, spec: &ImportSpec) -> Result<Imported, String> {
    decoder::reused(&file.into(), spec, |rows| convert(rows, spec))
        .map_err(|error| error.to_string())
}

fn error(file: impl Into<Vec<u8>>, spec: &ImportSpec) -> String {
    match import(file, spec) {
        Ok(imported) => panic!("imported: {:?}", imported.counts),
        Err(error) => error,
    }
}

#[track_caller]
fn check_refused(file: impl Into<Vec<u8>>, spec: &ImportSpec, expected: &[&str]) {
    let error = error(file, spec);
    for part in expected {
        assert!(error.contains(part), "{error:?} lacks {part:?}");
    }
}

fn ints(values: impl IntoIterator<Item = i32>) -> ArrayRef {
    Arc::new(Int32Array::from_iter_values(values))
}
