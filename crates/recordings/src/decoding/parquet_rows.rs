//! Rows of a Parquet file, one row group after the other and one batch at a time.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::{DataType, TimeUnit as ArrowTimeUnit};
use bytes::Bytes;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader,
    ParquetRecordBatchReaderBuilder,
};
use parquet::arrow::{ProjectionMask, parquet_to_arrow_schema_by_columns};
use parquet::basic::Compression;
use parquet::column::page::PageReader;
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::reader::{ChunkReader, Length};
use parquet::file::serialized_reader::SerializedPageReader;
use spec::{ImportSpec, TimeUnit};

use super::parquet_values::{Elements, complete, floats, is_decimal, lists, names, time_column};
use super::{DecodeError, first_bytes, signature};
use crate::rows::{MAX_BATCH_ROWS, Rows, TimeColumn};
use crate::selection::{MAX_ELEMENTS, find_elements};

const MAGIC: &[u8] = b"PAR1";

/// The footer's length and the magic bytes.
const TAIL: usize = 8;

/// The largest number of rows of a file: weeks at 1 kHz.
const MAX_ROWS: u64 = 1_000_000_000;

pub(super) struct ParquetRows<R> {
    file: SharedFile<R>,
    metadata: ArrowReaderMetadata,
    columns: Columns,
    /// The columns, in the order of `ImportColumns::named`.
    leaves: Vec<Leaf>,
    next_row_group: usize,
    batches: Option<ParquetRecordBatchReader>,
    next_row: u64,
}

/// The columns in the file, by their meaning.
struct Columns {
    time: Option<Channels>,
    /// The unit that the type of the time has.
    time_unit: Option<TimeUnit>,
    recording: Option<String>,
    channels: Vec<Channels>,
}

/// A column with one channel, or with lists of several.
struct Channels {
    name: String,
    /// The name in the spec, for errors.
    asked: String,
    /// The elements of each list; `None` for a flat column.
    elements: Option<Elements>,
}

/// A requested column.
#[derive(Clone)]
struct Leaf {
    /// Its position among the leaves of the schema.
    leaf: usize,
    /// The elements of each list; `None` for a flat column.
    elements: Option<Elements>,
}

impl<R: ChunkReader + 'static> ParquetRows<R> {
    /// # Errors
    /// When the file is not Parquet, a column is missing, or a column has an unsuitable type.
    pub fn open(file: R, spec: &ImportSpec) -> Result<Self, DecodeError> {
        check_ends(&file)?;
        // The types are Parquet's own. An Arrow schema that the writer added is ignored.
        let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
        let metadata = ArrowReaderMetadata::load(&file, options)?;
        check_row_counts(metadata.metadata())?;
        let leaves = find_leaves(metadata.metadata(), spec)?;
        let time_unit = check_types(metadata.metadata(), &leaves, spec)?;
        let schema = metadata.metadata().file_metadata().schema_descr();
        // In the order of `ImportColumns::named`.
        let named = spec.columns.named();
        let mut columns = leaves.iter().zip(&named).map(|(leaf, (_, asked))| Channels {
            name: schema.column(leaf.leaf).path().parts()[0].clone(),
            asked: asked.trim().to_owned(),
            elements: leaf.elements.clone(),
        });
        let columns = Columns {
            time: spec.columns.time.as_ref().and_then(|_| columns.next()),
            time_unit,
            recording: spec
                .columns
                .recording
                .as_ref()
                .and_then(|_| columns.next())
                .map(|recording| recording.name),
            channels: columns.collect(),
        };
        Ok(Self {
            file: SharedFile(Arc::new(file)),
            metadata,
            columns,
            leaves,
            next_row_group: 0,
            batches: None,
            next_row: 0,
        })
    }

    /// The next rows; `None` at the end.
    ///
    /// # Errors
    /// When the file is damaged, or a value is missing.
    pub fn next(&mut self) -> Result<Option<Rows>, DecodeError> {
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
            if self.next_row_group == self.metadata.metadata().num_row_groups() {
                return self.check_end().map(|()| None);
            }
            self.batches = Some(self.open_row_group(self.next_row_group)?);
            self.next_row_group += 1;
        }
    }

    /// Checks that no rows are missing, because a decoder may end early without an error.
    fn check_end(&self) -> Result<(), DecodeError> {
        let claimed = self.metadata.metadata().file_metadata().num_rows().unsigned_abs();
        if self.next_row == claimed {
            return Ok(());
        }
        let reason = format!("it claims {claimed} rows and has {}", self.next_row);
        Err(DecodeError::File(reason))
    }

    fn open_row_group(&self, index: usize) -> Result<ParquetRecordBatchReader, DecodeError> {
        for leaf in &self.leaves {
            self.check_column(index, leaf)?;
        }
        let (file, metadata) = (self.file.clone(), self.metadata.clone());
        let builder = ParquetRecordBatchReaderBuilder::new_with_metadata(file, metadata);
        let schema = builder.parquet_schema();
        let mask = ProjectionMask::leaves(schema, self.leaves.iter().map(|leaf| leaf.leaf));
        let builder = builder.with_projection(mask).with_row_groups(vec![index]);
        Ok(builder.with_batch_size(MAX_BATCH_ROWS).build()?)
    }

    /// Checks the number of values of a column. A decoder reads as many values as the row group has
    /// rows, and ignores further ones.
    fn check_column(&self, row_group: usize, leaf: &Leaf) -> Result<(), DecodeError> {
        let metadata = self.metadata.metadata().row_group(row_group);
        let column = metadata.column(leaf.leaf);
        let rows = usize::try_from(metadata.num_rows()).unwrap_or(0);
        let named = |reason: String| {
            let name = column.column_path().string();
            DecodeError::File(format!("column {name:?} of row group {row_group}: {reason}"))
        };
        check_codec(column.compression()).map_err(named)?;
        let mut pages = SerializedPageReader::new(Arc::clone(&self.file.0), column, rows, None)?;
        let mut values: usize = 0;
        while let Some(page) = pages.peek_next_page()? {
            values = values.saturating_add(page.num_levels.unwrap_or(0));
            pages.skip_next_page()?;
        }
        // A list that is too short is found with its row.
        let (most, lists) = match &leaf.elements {
            None if values != rows => (0, String::new()),
            None => return Ok(()),
            Some(Elements::All(elements)) => {
                (rows.saturating_mul(*elements), format!(" of {elements} elements"))
            }
            Some(Elements::Named(_)) => {
                (rows.saturating_mul(MAX_ELEMENTS), format!(" of at most {MAX_ELEMENTS} elements"))
            }
        };
        if values <= most {
            return Ok(());
        }
        if let Some(Elements::All(joints)) = leaf.elements
            && let Some(found) = values.checked_div(rows).filter(|found| found * rows == values)
        {
            let name = &column.column_path().parts()[0];
            return Err(DecodeError::File(format!(
                "column {name:?} has lists of {found} numbers, allowed: {joints}, one for each joint; \
                 name elements as {:?}, or a range as {:?}",
                format!("{name}[0]"),
                format!("{name}[0:{joints}]")
            )));
        }
        let rows = format!("{rows} rows{lists}");
        Err(named(format!("its pages have {values} values where the row group has {rows}")))
    }
}

/// A file that several column readers share.
struct SharedFile<R>(Arc<R>);

impl<R> Clone for SharedFile<R> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<R: Length> Length for SharedFile<R> {
    fn len(&self) -> u64 {
        self.0.len()
    }
}

impl<R: ChunkReader> ChunkReader for SharedFile<R> {
    type T = R::T;

    fn get_read(&self, start: u64) -> parquet::errors::Result<Self::T> {
        self.0.get_read(start)
    }

    fn get_bytes(&self, start: u64, length: usize) -> parquet::errors::Result<Bytes> {
        self.0.get_bytes(start, length)
    }
}

/// Checks the beginning and the end of the file. The decoder would also refuse these, but its
/// messages do not help.
fn check_ends<R: ChunkReader>(file: &R) -> Result<(), DecodeError> {
    let size = file.len();
    let no_parquet =
        |reason: &str| Err(DecodeError::File(format!("it is not a Parquet file: {reason}")));
    let first = first_bytes(file)?;
    let is_parquet = first.starts_with(MAGIC);
    if !is_parquet && let Some(reason) = signature::describe(&first) {
        return Err(DecodeError::File(reason));
    }
    if size < (MAGIC.len() + TAIL) as u64 {
        return no_parquet(&format!("it has {size} bytes, and a Parquet file has at least 12"));
    }
    if !is_parquet {
        return no_parquet("it does not begin with PAR1");
    }
    let tail = file.get_bytes(size - TAIL as u64, TAIL)?;
    if tail[4..] != *MAGIC {
        return no_parquet("it does not end with PAR1: it was cut off, or encrypted");
    }
    let length = u32::from_le_bytes([tail[0], tail[1], tail[2], tail[3]]);
    let room = size - (MAGIC.len() + TAIL) as u64;
    if u64::from(length) > room {
        let reason = format!("its footer claims {length} bytes, and there are {room}");
        return Err(DecodeError::File(reason));
    }
    Ok(())
}

/// Checks the codec, because the program has no decoders for the others.
fn check_codec(codec: Compression) -> Result<(), String> {
    match codec {
        Compression::UNCOMPRESSED
        | Compression::SNAPPY
        | Compression::GZIP(_)
        | Compression::ZSTD(_)
        | Compression::LZ4
        | Compression::LZ4_RAW => Ok(()),
        other => {
            let allowed = "none, snappy, gzip, zstd, lz4, lz4-raw";
            Err(format!("it is compressed with {other}, allowed: {allowed}"))
        }
    }
}

fn check_row_counts(metadata: &ParquetMetaData) -> Result<(), DecodeError> {
    let claimed = metadata.file_metadata().num_rows();
    let mut rows: u64 = 0;
    for row_group in metadata.row_groups() {
        let count = u64::try_from(row_group.num_rows()).unwrap_or(u64::MAX);
        rows = rows.saturating_add(count);
    }
    if rows > MAX_ROWS {
        let reason = format!("it claims {rows} rows, allowed: at most {MAX_ROWS}");
        return Err(DecodeError::File(reason));
    }
    if u64::try_from(claimed) != Ok(rows) {
        let reason = format!("it claims {claimed} rows, and its row groups {rows}");
        return Err(DecodeError::File(reason));
    }
    Ok(())
}

/// Finds the requested columns. Columns inside structs, and lists of lists, are ignored.
fn find_leaves(metadata: &ParquetMetaData, spec: &ImportSpec) -> Result<Vec<Leaf>, DecodeError> {
    let schema = metadata.file_metadata().schema_descr();
    let mut leaves_of: HashMap<usize, usize> = HashMap::new();
    for leaf in 0..schema.num_columns() {
        *leaves_of.entry(schema.get_column_root_idx(leaf)).or_default() += 1;
    }
    let is_list = |leaf: usize| schema.column(leaf).max_rep_level() == 1;
    let known: Vec<(usize, &str)> = schema
        .columns()
        .iter()
        .enumerate()
        .filter(|(leaf, column)| match column.max_rep_level() {
            0 => column.path().parts().len() == 1,
            1 => leaves_of[&schema.get_column_root_idx(*leaf)] == 1,
            _ => false,
        })
        .map(|(leaf, column)| (leaf, column.path().parts()[0].as_str()))
        .collect();
    let names: Vec<&str> = known.iter().map(|(_, name)| *name).collect();
    let found = find_elements(spec, &names)
        .map_err(|error| DecodeError::File(format!("{error}{}", nested(metadata, spec, &names))))?;
    let leaves = spec.columns.named().into_iter().zip(found).map(|((field, asked), column)| {
        let (leaf, name) = known[column.place];
        let is_of_all =
            field.strip_suffix("[0]").is_some_and(|quantity| spec.has_one_column(quantity));
        match (is_list(leaf), column.elements) {
            (false, None) => Ok(Leaf { leaf, elements: None }),
            (true, Some(elements)) => Ok(Leaf { leaf, elements: Some(Elements::Named(elements)) }),
            (true, None) if is_of_all => {
                Ok(Leaf { leaf, elements: Some(Elements::All(spec.joints())) })
            }
            (true, None) => Err(DecodeError::File(format!(
                "column {name:?} (columns.{field}) has lists, allowed: a flat column, or an element such as \
                 {:?}; a column with a list of all joints is named alone, such as \"q\": [{name:?}]",
                format!("{name}[0]")
            ))),
            (false, Some(_)) => Err(DecodeError::File(format!(
                "columns.{field} is {asked:?}, but the column {name:?} has no lists"
            ))),
        }
    });
    leaves.collect()
}

/// Words about requested columns in structs, and about lists of lists.
fn nested(metadata: &ParquetMetaData, spec: &ImportSpec, known: &[&str]) -> String {
    let schema = metadata.file_metadata().schema_descr();
    let mut lists: Vec<&str> = schema
        .columns()
        .iter()
        .filter_map(|column| column.path().parts().first().map(String::as_str))
        .filter(|list| !known.contains(list))
        .filter(|list| {
            let is_asked_for = |name: &str| name.trim().split('[').next() == Some(list.trim());
            spec.columns.named().iter().any(|(_, name)| is_asked_for(name))
        })
        .collect();
    lists.dedup();
    let Some(first) = lists.first() else { return String::new() };
    let all: Vec<String> = lists.iter().map(|list| format!("{list:?}")).collect();
    let have = if lists.len() == 1 { "has" } else { "have" };
    format!(
        "; {} {have} structs or lists of lists, allowed: numbers, or lists of numbers such as {first:?}",
        all.join(" and "),
    )
}

/// Checks the types of the columns. Returns the unit that the type of the time has.
fn check_types(
    metadata: &ParquetMetaData,
    leaves: &[Leaf],
    spec: &ImportSpec,
) -> Result<Option<TimeUnit>, DecodeError> {
    let descriptor = metadata.file_metadata().schema_descr();
    let mut unit = None;
    for ((field, name), leaf) in spec.columns.named().into_iter().zip(leaves) {
        let Leaf { leaf, ref elements } = *leaf;
        let mask = ProjectionMask::leaves(descriptor, [leaf]);
        let schema = parquet_to_arrow_schema_by_columns(descriptor, mask, None)?;
        let column = schema.fields().first().ok_or_else(|| {
            DecodeError::File(format!("column {name:?} (columns.{field}) cannot be decoded"))
        })?;
        let found = column.data_type();
        if field == "time" {
            unit = duration_unit(metadata, leaf).or_else(|| own_unit(found));
        }
        let allowed = if field == "time"
            && let Some(unit) = unit
        {
            // Seconds are the default, too.
            if [unit, TimeUnit::S].contains(&spec.units.time) {
                continue;
            }
            format!("units.time {:?}, or none, as the column says its unit", unit.as_str())
        } else {
            let is_for_all = field != "time" && field != "recording" && spec.joints() > 1;
            let lists = format!("lists of {} numbers", spec.joints());
            match (field.as_str(), found) {
                (_, DataType::List(element)) if elements.is_some() => {
                    if is_number(element.data_type()) {
                        continue;
                    }
                    lists
                }
                (field, _) if is_for_all && spec.has_one_column(field.trim_end_matches("[0]")) => {
                    format!("{lists}, as it is the only column")
                }
                ("recording", DataType::Utf8 | DataType::LargeUtf8) => continue,
                ("recording", other) if other.is_integer() => continue,
                ("recording", _) => "integers or text".to_owned(),
                (_, other) if is_number(other) => continue,
                _ => "integers, decimals, f16, f32 or f64".to_owned(),
            }
        };
        let reason = format!("column {name:?} (columns.{field}) is {found}, allowed: {allowed}");
        return Err(DecodeError::File(reason));
    }
    Ok(unit)
}

fn is_number(data_type: &DataType) -> bool {
    data_type.is_integer() || is_decimal(data_type)
}

/// The unit of dates and of times of a day.
const fn own_unit(data_type: &DataType) -> Option<TimeUnit> {
    match data_type {
        DataType::Timestamp(unit, _) | DataType::Time32(unit) | DataType::Time64(unit) => {
            Some(time_unit(*unit))
        }
        _ => None,
    }
}

/// The unit of durations. Parquet has no such type, so Arrow writes integers, and notes their type
/// in the schema that it adds. A schema that cannot be read says nothing.
fn duration_unit(metadata: &ParquetMetaData, leaf: usize) -> Option<TimeUnit> {
    let file = metadata.file_metadata();
    let mask = ProjectionMask::leaves(file.schema_descr(), [leaf]);
    let notes = file.key_value_metadata();
    let schema = parquet_to_arrow_schema_by_columns(file.schema_descr(), mask, notes).ok()?;
    match schema.fields().first()?.data_type() {
        DataType::Duration(unit) => Some(time_unit(*unit)),
        _ => None,
    }
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
    fn rows(&self, batch: &RecordBatch, first: u64) -> Result<Rows, DecodeError> {
        let column = |name: &str| complete(batch, name, first);
        let lists = |Channels { name, asked, .. }: &Channels, elements: &Elements| {
            lists(&column(name)?, elements, first, asked)
        };
        let time = |time: &Channels| match &time.elements {
            None => time_column(&column(&time.name)?, self.time_unit),
            Some(elements) => {
                Ok(TimeColumn::Decimal(lists(time, elements)?.pop().unwrap_or_default()))
            }
        };
        let time = self.time.as_ref().map(time).transpose()?;
        let recording =
            self.recording.as_deref().map(|name| names(&column(name)?, first, name)).transpose()?;
        let mut channels = Vec::new();
        for columns in &self.channels {
            match &columns.elements {
                None => channels.push(floats(&column(&columns.name)?)?),
                Some(elements) => channels.extend(lists(columns, elements)?),
            }
        }
        Ok(Rows { first, count: batch.num_rows(), time, recording, channels, ..Rows::default() })
    }
}

#[cfg(test)]
mod tests {
    use parquet::basic::BrotliLevel;

    use super::*;

    #[test]
    fn a_codec_that_is_not_built_in_is_refused_with_those_that_are() {
        assert!(check_codec(Compression::LZ4).is_ok());
        let brotli = check_codec(Compression::BROTLI(BrotliLevel::default())).unwrap_err();
        assert!(brotli.contains("BROTLI") && brotli.contains("gzip"), "{brotli}");
    }
}
