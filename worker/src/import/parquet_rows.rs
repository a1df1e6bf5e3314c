//! Rows of a Parquet file, a row group after the other and a batch at a time.

use std::sync::Arc;

use arrow::array::{Array, ArrayRef, AsArray, RecordBatch};
use arrow::compute::cast;
use arrow::datatypes::{DataType, Float64Type, Int64Type, TimeUnit as ArrowTimeUnit};
use parquet::arrow::arrow_reader::{ParquetRecordBatchReader, RowGroups};
use parquet::arrow::{
    ProjectionMask, parquet_to_arrow_field_levels, parquet_to_arrow_schema_by_columns,
};
use parquet::column::page::PageIterator;
use parquet::errors::ParquetError;
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};
use parquet::file::reader::ChunkReader;
use spec::{ImportSpec, TimeUnit};

use super::checked_pages::{CheckedPages, OneChunk};
use super::error::ImportError;
use super::rows::{Rows, TimeColumn, absent, channel_columns, check_name, find_columns};
use super::{footer, page_headers};

/// Rows decoded at a time.
const BATCH_ROWS: usize = 8192;

/// Bytes of the pages of all columns that lie open at a time.
const MAX_PAGE_BYTES: u64 = 512 << 20;

/// Rows of a file: weeks at 1 kHz.
const MAX_ROWS: u64 = 1_000_000_000;

pub(super) struct ParquetRows<R: ChunkReader> {
    file: Arc<R>,
    metadata: Arc<ParquetMetaData>,
    columns: Columns,
    /// Positions of the columns in the file.
    leaves: Vec<usize>,
    next_row_group: usize,
    batches: Option<ParquetRecordBatchReader>,
    next_row: u64,
}

/// The names of the columns by what they are.
struct Columns {
    time: Option<String>,
    recording: Option<String>,
    channels: Vec<String>,
}

impl<R: ChunkReader + 'static> ParquetRows<R> {
    /// # Errors
    /// When the file is no Parquet, lacks a column, or has one that is not what is asked for.
    pub fn open(file: R, spec: &ImportSpec) -> Result<Self, ImportError> {
        footer::check(&file)?;
        let metadata = Arc::new(ParquetMetaDataReader::new().parse_and_finish(&file)?);
        check_row_counts(&metadata)?;
        let leaves = find_leaves(&metadata, spec)?;
        check_types(&metadata, &leaves, spec)?;
        let columns = Columns {
            time: spec.columns.time.clone(),
            recording: spec.columns.recording.clone(),
            channels: channel_columns(&spec.columns).into_iter().map(str::to_owned).collect(),
        };
        Ok(Self {
            file: Arc::new(file),
            metadata,
            columns,
            leaves,
            next_row_group: 0,
            batches: None,
            next_row: 0,
        })
    }

    /// The rows that follow, or `None` at the end.
    ///
    /// # Errors
    /// When the file is damaged, or a value is missing.
    pub fn next(&mut self) -> Result<Option<Rows>, ImportError> {
        loop {
            if let Some(batches) = &mut self.batches {
                if let Some(batch) = batches.next() {
                    let batch = batch.map_err(|error| ParquetError::External(Box::new(error)))?;
                    let rows = self.columns.rows(&batch, self.next_row)?;
                    self.next_row += batch.num_rows() as u64;
                    return Ok(Some(rows));
                }
                self.batches = None;
            }
            if self.next_row_group == self.metadata.num_row_groups() {
                return self.check_end().map(|()| None);
            }
            self.batches = Some(self.open_row_group(self.next_row_group)?);
            self.next_row_group += 1;
        }
    }

    /// A decoder may come to its end early without saying so.
    fn check_end(&self) -> Result<(), ImportError> {
        let claimed = self.metadata.file_metadata().num_rows().unsigned_abs();
        if self.next_row == claimed {
            return Ok(());
        }
        let reason = format!("it claims {claimed} rows and has {}", self.next_row);
        Err(ImportError::file(reason))
    }

    fn open_row_group(&self, index: usize) -> Result<ParquetRecordBatchReader, ImportError> {
        let row_group = self.metadata.row_group(index);
        let rows = row_group.num_rows().unsigned_abs();
        let mut memory: u64 = 0;
        for leaf in &self.leaves {
            let chunk = row_group.column(*leaf);
            let bytes = page_headers::check(self.file.as_ref(), chunk, rows).map_err(|error| {
                let name = chunk.column_path().string();
                ImportError::file(format!("column {name:?} of row group {index}: {error}"))
            })?;
            memory = memory.saturating_add(bytes);
        }
        if memory > MAX_PAGE_BYTES {
            let reason = format!(
                "the pages of row group {index} need {memory} bytes of memory at once, at most \
                 {MAX_PAGE_BYTES} are given; write it with smaller pages or row groups"
            );
            return Err(ImportError::file(reason));
        }
        let schema = self.metadata.file_metadata().schema_descr();
        let mask = ProjectionMask::leaves(schema, self.leaves.iter().copied());
        let levels = parquet_to_arrow_field_levels(schema, mask, None)?;
        let row_group = OneRowGroup {
            file: Arc::clone(&self.file),
            metadata: Arc::clone(&self.metadata),
            index,
        };
        Ok(ParquetRecordBatchReader::try_new_with_row_groups(
            &levels, &row_group, BATCH_ROWS, None,
        )?)
    }
}

fn check_row_counts(metadata: &ParquetMetaData) -> Result<(), ImportError> {
    let claimed = metadata.file_metadata().num_rows();
    let mut rows: u64 = 0;
    for row_group in metadata.row_groups() {
        let count = u64::try_from(row_group.num_rows()).unwrap_or(u64::MAX);
        rows = rows.saturating_add(count);
    }
    if rows > MAX_ROWS {
        let reason = format!("it claims {rows} rows, allowed are {MAX_ROWS}");
        return Err(ImportError::file(reason));
    }
    if u64::try_from(claimed) != Ok(rows) {
        let reason = format!("it claims {claimed} rows, and its row groups {rows}");
        return Err(ImportError::file(reason));
    }
    Ok(())
}

/// Columns inside others are not looked at.
fn find_leaves(metadata: &ParquetMetaData, spec: &ImportSpec) -> Result<Vec<usize>, ImportError> {
    let schema = metadata.file_metadata().schema_descr();
    let flat: Vec<(usize, &str)> = schema
        .columns()
        .iter()
        .enumerate()
        .filter(|(_, column)| column.path().parts().len() == 1 && column.max_rep_level() == 0)
        .map(|(leaf, column)| (leaf, column.name()))
        .collect();
    let names: Vec<&str> = flat.iter().map(|(_, name)| *name).collect();
    let found = find_columns(&spec.columns, &names)?;
    Ok(found.into_iter().map(|place| flat[place].0).collect())
}

fn check_types(
    metadata: &ParquetMetaData,
    leaves: &[usize],
    spec: &ImportSpec,
) -> Result<(), ImportError> {
    let schema = metadata.file_metadata().schema_descr();
    let mask = ProjectionMask::leaves(schema, leaves.iter().copied());
    let schema = parquet_to_arrow_schema_by_columns(schema, mask, None)?;
    for (field, name) in spec.columns.named() {
        let (_, column) = schema.column_with_name(name).ok_or_else(|| {
            ImportError::file(format!("column {name:?} (columns.{field}) cannot be decoded"))
        })?;
        let found = column.data_type();
        let allowed = match (field.as_str(), found) {
            ("recording", DataType::Utf8 | DataType::LargeUtf8) => continue,
            ("recording", other) if other.is_integer() => continue,
            ("time", DataType::Timestamp(unit, _)) if time_unit(*unit) == spec.units.time => {
                continue;
            }
            ("time", DataType::Timestamp(unit, _)) => {
                let unit = time_unit(*unit).as_str();
                format!("this one with units.time {unit:?}")
            }
            ("recording", _) => "integers or text".to_owned(),
            (_, other) if is_number(other) => continue,
            _ => "integers, f32 or f64".to_owned(),
        };
        let reason = format!("column {name:?} (columns.{field}) is {found}, allowed: {allowed}");
        return Err(ImportError::file(reason));
    }
    Ok(())
}

fn is_number(data_type: &DataType) -> bool {
    data_type.is_integer() || matches!(data_type, DataType::Float32 | DataType::Float64)
}

const fn time_unit(unit: ArrowTimeUnit) -> TimeUnit {
    match unit {
        ArrowTimeUnit::Second => TimeUnit::S,
        ArrowTimeUnit::Millisecond => TimeUnit::Ms,
        ArrowTimeUnit::Microsecond => TimeUnit::Us,
        ArrowTimeUnit::Nanosecond => TimeUnit::Ns,
    }
}

impl Columns {
    fn rows(&self, batch: &RecordBatch, first: u64) -> Result<Rows, ImportError> {
        let column = |name: &str| complete(batch, name, first);
        let numbers = |name: &str| -> Result<Vec<f64>, ImportError> {
            let values = cast_to(&column(name)?, &DataType::Float64)?;
            Ok(values.as_primitive::<Float64Type>().values().to_vec())
        };
        let time = self.time.as_deref().map(|name| time_column(&column(name)?)).transpose()?;
        let recording =
            self.recording.as_deref().map(|name| names(&column(name)?, first, name)).transpose()?;
        let channels = self.channels.iter().map(|name| numbers(name)).collect::<Result<_, _>>()?;
        Ok(Rows { first, count: batch.num_rows(), time, recording, channels })
    }
}

/// A column without nulls.
fn complete(batch: &RecordBatch, name: &str, first: u64) -> Result<ArrayRef, ImportError> {
    let column = batch
        .column_by_name(name)
        .ok_or_else(|| ImportError::file(format!("column {name:?} cannot be decoded")))?;
    if column.null_count() > 0 {
        let row = (0..column.len()).position(|row| column.is_null(row)).unwrap_or(0);
        return Err(absent(first + row as u64, name).into());
    }
    Ok(Arc::clone(column))
}

fn time_column(column: &ArrayRef) -> Result<TimeColumn, ImportError> {
    Ok(match column.data_type() {
        DataType::Float32 | DataType::Float64 => {
            let values = cast_to(column, &DataType::Float64)?;
            TimeColumn::Decimal(values.as_primitive::<Float64Type>().values().to_vec())
        }
        _ => {
            let values = cast_to(column, &DataType::Int64)?;
            if values.null_count() > 0 {
                return Err(ImportError::file("its times do not fit into 64 bits with a sign"));
            }
            TimeColumn::Integer(values.as_primitive::<Int64Type>().values().to_vec())
        }
    })
}

fn names(column: &ArrayRef, first: u64, name: &str) -> Result<Vec<String>, ImportError> {
    let text = cast_to(column, &DataType::Utf8)?;
    let mut names = Vec::with_capacity(text.len());
    for (row, value) in (first..).zip(text.as_string::<i32>()) {
        let value = value.unwrap_or_default();
        check_name(value, row, name)?;
        names.push(value.to_owned());
    }
    Ok(names)
}

fn cast_to(column: &ArrayRef, data_type: &DataType) -> Result<ArrayRef, ImportError> {
    cast(column, data_type).map_err(|error| ParquetError::External(Box::new(error)).into())
}

/// A row group whose pages are checked before they are decoded.
struct OneRowGroup<R: ChunkReader> {
    file: Arc<R>,
    metadata: Arc<ParquetMetaData>,
    index: usize,
}

impl<R: ChunkReader + 'static> RowGroups for OneRowGroup<R> {
    fn num_rows(&self) -> usize {
        let rows = self.metadata.row_group(self.index).num_rows();
        usize::try_from(rows).unwrap_or(0)
    }

    fn column_chunks(&self, column: usize) -> parquet::errors::Result<Box<dyn PageIterator>> {
        let chunk = self.metadata.row_group(self.index).column(column);
        let pages = CheckedPages::new(Arc::clone(&self.file), chunk, self.num_rows())?;
        Ok(Box::new(OneChunk(Some(pages))))
    }

    fn row_groups(&self) -> Box<dyn Iterator<Item = &RowGroupMetaData> + '_> {
        Box::new(std::iter::once(self.metadata.row_group(self.index)))
    }

    fn metadata(&self) -> &ParquetMetaData {
        &self.metadata
    }
}
