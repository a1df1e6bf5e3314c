//! Rows of a CSV file (RFC 4180: commas, double quotes, a header), a batch at a time.

use std::cell::{Cell, RefCell};
use std::io::{self, Read};
use std::rc::Rc;

use csv::{ByteRecord, Reader, ReaderBuilder};
use spec::ImportSpec;

use super::DecodeError;
use super::line_count::Lines;
use crate::rows::{
    MAX_BATCH_ROWS, Rows, TimeColumn, absent, channel_columns, check_name, find_columns,
};
use crate::{Place, RowError};

/// Number of rows that are parsed at once.
const BATCH_ROWS: usize = 1024;
const _: () = assert!(BATCH_ROWS <= MAX_BATCH_ROWS);

/// Largest number of bytes of a record. A record has several lines if a quoted value has line
/// breaks.
const MAX_RECORD_BYTES: usize = 64 * 1024;

/// Number of bytes that the CSV reader takes at once. It may be ahead of the returned record by
/// this much.
const BUFFER_BYTES: usize = 64 * 1024;

pub(super) struct CsvRows {
    reader: Reader<Metered<Box<dyn Read>>>,
    budget: Budget,
    lines: Rc<RefCell<Lines>>,
    record: ByteRecord,
    time: Option<CsvColumn>,
    recording: Option<CsvColumn>,
    channels: Vec<CsvColumn>,
    next_row: u64,
}

/// A requested column: its index in the file, and its name for errors.
struct CsvColumn {
    place: usize,
    name: String,
}

impl CsvRows {
    /// # Errors
    /// When the file has no header, or a requested column is missing.
    pub fn open(file: Box<dyn Read>, spec: &ImportSpec) -> Result<Self, DecodeError> {
        let budget = Budget::default();
        let lines = Rc::default();
        let file = Metered { inner: file, budget: budget.clone(), lines: Rc::clone(&lines) };
        let mut reader =
            ReaderBuilder::new().has_headers(true).buffer_capacity(BUFFER_BYTES).from_reader(file);
        let header = reader.byte_headers().map_err(|error| explained(error, 0, 1))?.clone();
        budget.refill();
        lines.borrow_mut().pass(reader.position().byte());
        let names = header_names(&header)?;
        let places = find_columns(&spec.columns, &names)
            .map_err(|error| DecodeError::File(missing(&error, &names)))?;
        let mut places = places.into_iter();
        let mut column = |name: &str| {
            let place = places.next().unwrap_or_default();
            CsvColumn { place, name: name.to_owned() }
        };
        // The order of `ImportColumns::named` is also that of the indices.
        let time = spec.columns.time.as_deref().map(&mut column);
        let recording = spec.columns.recording.as_deref().map(&mut column);
        let channels = channel_columns(&spec.columns).into_iter().map(&mut column).collect();
        let record = ByteRecord::new();
        Ok(Self { reader, budget, lines, record, time, recording, channels, next_row: 0 })
    }

    /// The next rows; `None` at the end.
    ///
    /// # Errors
    /// When a line has a different number of columns than the header, or a value is missing or is
    /// not a number.
    pub fn next(&mut self) -> Result<Option<Rows>, DecodeError> {
        let mut rows = Rows { first: self.next_row, ..Rows::default() };
        let mut lines = Vec::with_capacity(BATCH_ROWS);
        let mut times = Times::default();
        let mut names = Vec::new();
        rows.channels = vec![Vec::with_capacity(BATCH_ROWS); self.channels.len()];
        while rows.count < BATCH_ROWS {
            let Some(line) = self.read_record()? else { break };
            let place = Place::Line(line);
            lines.push(line);
            if let Some(column) = &self.time {
                times.push(self.text(column, place)?, place, &column.name)?;
            }
            if let Some(column) = &self.recording {
                let name = self.text(column, place)?;
                check_name(name, place, &column.name)?;
                names.push(name.to_owned());
            }
            for (values, column) in rows.channels.iter_mut().zip(&self.channels) {
                values.push(number(self.text(column, place)?, place, &column.name)?);
            }
            rows.count += 1;
            self.next_row += 1;
        }
        rows.lines = Some(lines);
        rows.time = self.time.is_some().then(|| times.finish());
        rows.recording = self.recording.is_some().then_some(names);
        Ok((rows.count > 0).then_some(rows))
    }

    /// Reads the next record. Returns the line in which it begins, or `None` at the end.
    fn read_record(&mut self) -> Result<Option<u64>, DecodeError> {
        let before = self.lines.borrow().last();
        let more = self.reader.read_byte_record(&mut self.record);
        let last = self.lines.borrow_mut().pass(self.reader.position().byte());
        let line = last - self.record.iter().map(Lines::within).sum::<u64>();
        if !more.map_err(|error| explained(error, before, line))? {
            return Ok(None);
        }
        self.budget.refill();
        Ok(Some(line))
    }

    fn text(&self, column: &CsvColumn, place: Place) -> Result<&str, RowError> {
        // The reader has refused records with another length than the header.
        let bytes = self.record.get(column.place).unwrap_or_default();
        let text = std::str::from_utf8(bytes).map_err(|_| {
            RowError::value(place, &column.name, "bytes that are not UTF-8 text", "UTF-8")
        })?;
        let text = text.trim();
        if text.is_empty() { Err(absent(place, &column.name)) } else { Ok(text) }
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

/// Explains why columns are missing that `error` names.
fn missing(error: &str, names: &[&str]) -> String {
    let numbers = names.iter().filter(|name| name.parse::<f64>().is_ok()).count();
    // The name of a recording may be a text.
    if 2 * numbers > names.len() {
        let first: Vec<&str> = names.iter().take(3).copied().collect();
        return format!(
            "it has no header: its first line has numbers instead of names ({}, ..); add a first \
             line with the name of each column",
            first.join(", ")
        );
    }
    let doubt = if names.len() == 1 { "; columns are separated by commas" } else { "" };
    format!("{error}{doubt}")
}

fn number(text: &str, place: Place, column: &str) -> Result<f64, RowError> {
    text.parse().map_err(|_| no_number(text, place, column))
}

fn no_number(text: &str, place: Place, column: &str) -> RowError {
    const SHOWN: usize = 40;
    let shown: String = text.chars().take(SHOWN).collect();
    RowError::value(place, column, format!("{shown:?}"), "a number such as -0.25 or 1e-3")
}

/// Times as they come. They stay integers as long as all of them are.
#[derive(Default)]
struct Times {
    integers: Vec<i64>,
    decimals: Vec<f64>,
}

impl Times {
    fn push(&mut self, text: &str, place: Place, column: &str) -> Result<(), RowError> {
        if self.decimals.is_empty() {
            if let Ok(time) = text.parse() {
                self.integers.push(time);
                return Ok(());
            }
            #[expect(clippy::cast_precision_loss, reason = "the file mixes them with decimals")]
            self.decimals.extend(self.integers.drain(..).map(|time| time as f64));
        }
        self.decimals.push(number(text, place, column)?);
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

/// Number of bytes that may be read until the present record ends. Without a limit, a quote that is
/// never closed would read the rest of the file into memory.
#[derive(Clone, Default)]
struct Budget(Rc<Cell<usize>>);

impl Budget {
    /// Resets the limit after another record was read.
    fn refill(&self) {
        self.0.set(0);
    }
}

struct Metered<R> {
    inner: R,
    budget: Budget,
    lines: Rc<RefCell<Lines>>,
}

impl<R: Read> Read for Metered<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.lines.borrow_mut().see(&buffer[..read]);
        let total = self.budget.0.get() + read;
        self.budget.0.set(total);
        // All or a part of the earlier bytes are still in the buffer.
        if total > MAX_RECORD_BYTES + BUFFER_BYTES {
            return Err(io::Error::new(io::ErrorKind::InvalidData, RECORD_TOO_LONG));
        }
        Ok(read)
    }
}

const RECORD_TOO_LONG: &str = "a line is too long";

/// Explains why the record in `line`, which comes after `before`, cannot be read.
fn explained(error: csv::Error, before: u64, line: u64) -> DecodeError {
    match error.kind() {
        csv::ErrorKind::Io(reason) if reason.to_string() == RECORD_TOO_LONG => {
            DecodeError::File(format!(
                "a line after line {before} has more than {MAX_RECORD_BYTES} bytes; is a quote in it \
                 never closed?"
            ))
        }
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => DecodeError::File(format!(
            "line {line} has {len} values, allowed: {expected_len}, as many as the header has columns"
        )),
        _ => error.into(),
    }
}
