//! Rows of a CSV file (RFC 4180: commas, double quotes, a header), a batch at a time.

use std::cell::Cell;
use std::io::{self, Read};
use std::rc::Rc;

use csv::{ByteRecord, Reader, ReaderBuilder};
use spec::ImportSpec;

use super::DecodeError;
use crate::RowError;
use crate::rows::{
    MAX_BATCH_ROWS, Rows, TimeColumn, absent, channel_columns, check_name, find_columns,
};

/// Rows parsed at a time.
const BATCH_ROWS: usize = 1024;
const _: () = assert!(BATCH_ROWS <= MAX_BATCH_ROWS);

/// Bytes of a line, or of several when a quoted value has line breaks in it.
const MAX_RECORD_BYTES: usize = 64 * 1024;

/// What the reader below takes at once: how far it may be ahead of the record it hands out.
const BUFFER_BYTES: usize = 64 * 1024;

pub(super) struct CsvRows {
    reader: Reader<Metered<Box<dyn Read>>>,
    budget: Budget,
    record: ByteRecord,
    time: Option<Column>,
    recording: Option<Column>,
    channels: Vec<Column>,
    next_row: u64,
}

/// A column that is asked for: its place in the file, and its name for errors.
struct Column {
    place: usize,
    name: String,
}

impl CsvRows {
    /// # Errors
    /// When the file has no header, or one without a column that is asked for.
    pub fn open(file: Box<dyn Read>, spec: &ImportSpec) -> Result<Self, DecodeError> {
        let budget = Budget::default();
        let file = Metered { inner: file, budget: budget.clone() };
        let mut reader =
            ReaderBuilder::new().has_headers(true).buffer_capacity(BUFFER_BYTES).from_reader(file);
        let header = reader.byte_headers().map_err(|error| too_long(error, 0))?.clone();
        budget.refill();
        let names = header_names(&header)?;
        let places = find_columns(&spec.columns, &names)
            .map_err(|error| if names.len() == 1 { without_commas(&error) } else { error })
            .map_err(DecodeError::File)?;
        let mut places = places.into_iter();
        let mut column = |name: &str| {
            let place = places.next().unwrap_or_default();
            Column { place, name: name.to_owned() }
        };
        // The order of `ImportColumns::named`, which is that of the places.
        let time = spec.columns.time.as_deref().map(&mut column);
        let recording = spec.columns.recording.as_deref().map(&mut column);
        let channels = channel_columns(&spec.columns).into_iter().map(&mut column).collect();
        let record = ByteRecord::new();
        Ok(Self { reader, budget, record, time, recording, channels, next_row: 0 })
    }

    /// The rows that follow, or `None` at the end.
    ///
    /// # Errors
    /// When a line has other columns than the header, or a value is missing or no number.
    pub fn next(&mut self) -> Result<Option<Rows>, DecodeError> {
        let mut rows = Rows { first: self.next_row, ..Rows::default() };
        let mut times = Times::default();
        let mut names = Vec::new();
        rows.channels = vec![Vec::with_capacity(BATCH_ROWS); self.channels.len()];
        while rows.count < BATCH_ROWS {
            let row = self.next_row;
            let more = self.reader.read_byte_record(&mut self.record);
            if !more.map_err(|error| too_long(error, row))? {
                break;
            }
            self.budget.refill();
            if let Some(column) = &self.time {
                times.push(self.text(column, row)?, row, &column.name)?;
            }
            if let Some(column) = &self.recording {
                let name = self.text(column, row)?;
                check_name(name, row, &column.name)?;
                names.push(name.to_owned());
            }
            for (values, column) in rows.channels.iter_mut().zip(&self.channels) {
                values.push(number(self.text(column, row)?, row, &column.name)?);
            }
            rows.count += 1;
            self.next_row += 1;
        }
        rows.time = self.time.is_some().then(|| times.finish());
        rows.recording = self.recording.is_some().then_some(names);
        Ok((rows.count > 0).then_some(rows))
    }

    fn text(&self, column: &Column, row: u64) -> Result<&str, RowError> {
        // The reader has refused records of other lengths than the header's.
        let bytes = self.record.get(column.place).unwrap_or_default();
        let text = std::str::from_utf8(bytes)
            .map_err(|_| RowError::value(row, &column.name, "bytes that are no text", "UTF-8"))?;
        let text = text.trim();
        if text.is_empty() { Err(absent(row, &column.name)) } else { Ok(text) }
    }
}

fn header_names(header: &ByteRecord) -> Result<Vec<&str>, DecodeError> {
    let mut names = Vec::with_capacity(header.len());
    for name in header {
        let name = std::str::from_utf8(name).map_err(|_| {
            DecodeError::File("the names in its first line are not UTF-8".to_owned())
        })?;
        names.push(name.trim_start_matches('\u{feff}').trim());
    }
    if names.is_empty() {
        let reason = "it is empty; its first line should name the columns";
        return Err(DecodeError::File(reason.to_owned()));
    }
    Ok(names)
}

fn without_commas(error: &str) -> String {
    format!("{error}; columns are separated by commas")
}

fn number(text: &str, row: u64, column: &str) -> Result<f64, RowError> {
    text.parse().map_err(|_| no_number(text, row, column))
}

fn no_number(text: &str, row: u64, column: &str) -> RowError {
    const SHOWN: usize = 40;
    let shown: String = text.chars().take(SHOWN).collect();
    RowError::value(row, column, format!("{shown:?}"), "a number such as -0.25 or 1e-3")
}

/// Times as they come, whole as long as all of them are.
#[derive(Default)]
struct Times {
    integers: Vec<i64>,
    decimals: Vec<f64>,
}

impl Times {
    fn push(&mut self, text: &str, row: u64, column: &str) -> Result<(), RowError> {
        if self.decimals.is_empty() {
            if let Ok(time) = text.parse() {
                self.integers.push(time);
                return Ok(());
            }
            #[expect(clippy::cast_precision_loss, reason = "the file mixes them with decimals")]
            self.decimals.extend(self.integers.drain(..).map(|time| time as f64));
        }
        self.decimals.push(number(text, row, column)?);
        Ok(())
    }

    fn finish(self) -> TimeColumn {
        if self.decimals.is_empty() {
            TimeColumn::Integer(self.integers)
        } else {
            TimeColumn::Decimal(self.decimals)
        }
    }
}

/// Bytes that may be read until the record at hand ends: a quote that is never closed would
/// otherwise take the rest of the file into memory.
#[derive(Clone, Default)]
struct Budget(Rc<Cell<usize>>);

impl Budget {
    /// Another record was read.
    fn refill(&self) {
        self.0.set(0);
    }
}

struct Metered<R> {
    inner: R,
    budget: Budget,
}

impl<R: Read> Read for Metered<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        let total = self.budget.0.get() + read;
        self.budget.0.set(total);
        // What was read before lies in the buffer whole or in part.
        if total > MAX_RECORD_BYTES + BUFFER_BYTES {
            return Err(io::Error::new(io::ErrorKind::InvalidData, RECORD_TOO_LONG));
        }
        Ok(read)
    }
}

const RECORD_TOO_LONG: &str = "a line is too long";

/// Puts the limit on a line into words.
fn too_long(error: csv::Error, row: u64) -> DecodeError {
    if let csv::ErrorKind::Io(reason) = error.kind()
        && reason.kind() == io::ErrorKind::InvalidData
        && reason.to_string() == RECORD_TOO_LONG
    {
        let reason = format!(
            "row {row} has more than {MAX_RECORD_BYTES} bytes; is a quote in it never closed?"
        );
        return DecodeError::File(reason);
    }
    error.into()
}
