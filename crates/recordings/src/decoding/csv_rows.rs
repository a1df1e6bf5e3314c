//! Rows of a CSV file (RFC 4180: double quotes), a batch at a time.

use std::cell::{Cell, RefCell};
use std::io::{self, Read};
use std::rc::Rc;

use csv::{ByteRecord, Reader, ReaderBuilder};
use spec::{CsvLayout, ImportSpec};

use super::DecodeError;
use super::line_count::Lines;
use super::spaces::OneSpace;
use crate::rows::{MAX_BATCH_ROWS, Rows, TimeColumn, absent, channel_columns, check_name};
use crate::selection::find_columns;
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
    /// Number of values of every record.
    values: usize,
    layout: CsvLayout,
    time: Option<CsvColumn>,
    recording: Option<CsvColumn>,
    channels: Vec<CsvColumn>,
    next_row: u64,
    /// Whether the last line was read, and is cut off.
    is_cut_off: bool,
}

/// A requested column: its index in the file, and its name for errors.
struct CsvColumn {
    place: usize,
    name: String,
}

impl CsvRows {
    /// # Errors
    /// When the file is empty, or a requested column is missing.
    pub fn open(file: Box<dyn Read>, spec: &ImportSpec) -> Result<Self, DecodeError> {
        let layout = spec.csv;
        let budget = Budget::default();
        let lines = Rc::default();
        // A space means any number of them, but the reader knows only single separators.
        let file = match layout.separator {
            ' ' => Box::new(OneSpace::new(file)),
            _ => file,
        };
        let file = Metered { inner: file, budget: budget.clone(), lines: Rc::clone(&lines) };
        let separator = u8::try_from(layout.separator).unwrap_or(b',');
        let mut reader = ReaderBuilder::new()
            .has_headers(layout.header)
            .delimiter(separator)
            .flexible(true)
            .buffer_capacity(BUFFER_BYTES)
            .from_reader(file);
        let first = reader.byte_headers().map_err(|error| explained(error, 0))?.clone();
        budget.refill();
        lines.borrow_mut().pass(reader.position().byte());
        let numbers: Vec<String> = (1..=first.len()).map(|number| number.to_string()).collect();
        let names = match layout.header {
            true => header_names(&first)?,
            false => numbers.iter().map(String::as_str).collect(),
        };
        if names.is_empty() {
            return Err(DecodeError::File(empty(layout)));
        }
        let places = find_columns(&spec.columns, &names)
            .map_err(|error| DecodeError::File(missing(&error, &names, layout)))?;
        let mut places = places.into_iter();
        let mut column = |name: &str| {
            let place = places.next().unwrap_or_default();
            CsvColumn { place, name: name.to_owned() }
        };
        // The order of `ImportColumns::named` is also that of the indices.
        let time = spec.columns.time.as_deref().map(&mut column);
        let recording = spec.columns.recording.as_deref().map(&mut column);
        let channels = channel_columns(&spec.columns).into_iter().map(&mut column).collect();
        Ok(Self {
            reader,
            budget,
            lines,
            record: ByteRecord::new(),
            values: first.len(),
            layout,
            time,
            recording,
            channels,
            next_row: 0,
            is_cut_off: false,
        })
    }

    /// The next rows; `None` at the end.
    ///
    /// # Errors
    /// When a line has a different number of columns than the first, or a value is missing or is
    /// not a number. The last line may be cut off.
    pub fn next(&mut self) -> Result<Option<Rows>, DecodeError> {
        let mut batch = Batch::new(self.channels.len());
        let mut cut_line = None;
        while batch.lines.len() < BATCH_ROWS && !self.is_cut_off {
            let Some(line) = self.read_record()? else { break };
            match self.read_row(line, &mut batch) {
                Ok(()) => batch.lines.push(line),
                Err(_) if self.has_rows(&batch) && self.ends_too_early() => {
                    (self.is_cut_off, cut_line) = (true, Some(line));
                }
                Err(error) => return Err(error),
            }
        }
        let count = batch.lines.len();
        let first = self.next_row;
        self.next_row += count as u64;
        if count == 0 && cut_line.is_none() {
            return Ok(None);
        }
        // Values of a line that is cut off are none.
        batch.channels.iter_mut().for_each(|values| values.truncate(count));
        batch.names.truncate(count);
        let time = self.time.is_some().then(|| batch.times.finish(count));
        let recording = self.recording.is_some().then_some(batch.names);
        let lines = Some(batch.lines);
        let (file, channels) = (None, batch.channels);
        Ok(Some(Rows { file, first, count, lines, cut_line, time, recording, channels }))
    }

    /// Adds the values of the present record, which is in this line.
    fn read_row(&self, line: u64, batch: &mut Batch) -> Result<(), DecodeError> {
        let (found, values) = (self.record.len(), self.values);
        if found != values {
            let like = if self.layout.header { "the header has columns" } else { "the first line" };
            return Err(DecodeError::File(format!(
                "line {line} has {found} values, allowed: {values}, as many as {like}"
            )));
        }
        let place = Place::Line(line);
        if let Some(column) = &self.time {
            let text = self.text(column, place)?;
            batch.times.push(text, place, &column.name, self.layout)?;
        }
        if let Some(column) = &self.recording {
            let name = self.text(column, place)?;
            check_name(name, place, &column.name)?;
            batch.names.push(name.to_owned());
        }
        for (values, column) in batch.channels.iter_mut().zip(&self.channels) {
            let text = self.text(column, place)?;
            values.push(number(text, place, &column.name, self.layout)?);
        }
        Ok(())
    }

    const fn has_rows(&self, batch: &Batch) -> bool {
        self.next_row > 0 || !batch.lines.is_empty()
    }

    /// Whether the present record, which cannot be read, is the end of a file whose writer was
    /// stopped: the last one, which lacks values, or a part of its last value and the end of its
    /// line.
    fn ends_too_early(&mut self) -> bool {
        let lacks_values = self.record.len() < self.values;
        let has_all = self.record.len() == self.values;
        let last = self.record.get(self.values - 1).and_then(|last| str::from_utf8(last).ok());
        let is_whole =
            last.is_some_and(|last| number(last.trim(), Place::Line(0), "", self.layout).is_ok());
        let is_last = !self.reader.read_byte_record(&mut self.record).unwrap_or(true);
        let lacks_end = self.lines.borrow().ends_open() && has_all && !is_whole;
        is_last && (lacks_values || lacks_end)
    }

    /// Reads the next record. Returns the line in which it begins, or `None` at the end.
    fn read_record(&mut self) -> Result<Option<u64>, DecodeError> {
        let before = self.lines.borrow().last();
        let more = self.reader.read_byte_record(&mut self.record);
        let last = self.lines.borrow_mut().pass(self.reader.position().byte());
        let line = last - self.record.iter().map(Lines::within).sum::<u64>();
        if !more.map_err(|error| explained(error, before))? {
            return Ok(None);
        }
        self.budget.refill();
        Ok(Some(line))
    }

    fn text(&self, column: &CsvColumn, place: Place) -> Result<&str, RowError> {
        // Records of another length are refused before.
        let bytes = self.record.get(column.place).unwrap_or_default();
        let text = std::str::from_utf8(bytes).map_err(|_| {
            let allowed = "UTF-8; convert the file, such as with `iconv -f latin1 -t utf8`";
            RowError::value(place, &column.name, "bytes that are not UTF-8 text", allowed)
        })?;
        let text = text.trim();
        if text.is_empty() { Err(absent(place, &column.name)) } else { Ok(text) }
    }
}

fn header_names(header: &ByteRecord) -> Result<Vec<&str>, DecodeError> {
    let mut names = Vec::with_capacity(header.len());
    for name in header {
        let name = std::str::from_utf8(name).map_err(|_| {
            DecodeError::File(
                "the names in its first line are not UTF-8; convert the file, such as with `iconv -f \
                 latin1 -t utf8`"
                    .to_owned(),
            )
        })?;
        names.push(name.trim_start_matches('\u{feff}').trim());
    }
    Ok(names)
}

fn empty(layout: CsvLayout) -> String {
    match layout.header {
        true => "it is empty; its first line should name the columns".to_owned(),
        false => "it is empty".to_owned(),
    }
}

/// Explains why columns are missing that `error` names.
fn missing(error: &str, names: &[&str], layout: CsvLayout) -> String {
    let numbers = names.iter().filter(|name| name.parse::<f64>().is_ok()).count();
    // The name of a recording may be a text.
    if layout.header && 2 * numbers > names.len() {
        let first: Vec<&str> = names.iter().take(3).copied().collect();
        return format!(
            "it has no header: its first line has numbers instead of names ({}, ..); add a first \
             line with the name of each column, or say \"csv\": {{\"header\": false}} and name the \
             columns \"1\", \"2\", ..",
            first.join(", ")
        );
    }
    let separator = match layout.separator {
        ',' => "commas".to_owned(),
        other => format!("{other:?}"),
    };
    let doubt = match names.len() {
        1 => format!("; columns are separated by {separator}, or csv.separator says otherwise"),
        _ => String::new(),
    };
    format!("{error}{doubt}")
}

fn number(text: &str, place: Place, column: &str, layout: CsvLayout) -> Result<f64, RowError> {
    let number = match layout.decimal_comma {
        true => text.replace(',', ".").parse(),
        false => text.parse(),
    };
    number.map_err(|_| no_number(text, place, column, layout))
}

fn no_number(text: &str, place: Place, column: &str, layout: CsvLayout) -> RowError {
    const SHOWN: usize = 40;
    let shown: String = text.chars().take(SHOWN).collect();
    let example = if layout.decimal_comma { "-0,25" } else { "-0.25" };
    let mut allowed = format!("a number such as {example} or 1e-3");
    if !layout.decimal_comma && text.replacen(',', ".", 1).parse::<f64>().is_ok() {
        allowed.push_str("; if numbers have decimal commas, say so in csv.decimal_comma");
    }
    RowError::value(place, column, format!("{shown:?}"), allowed)
}

/// The values of several rows. The lists may have one more value than there are lines.
#[derive(Default)]
struct Batch {
    lines: Vec<u64>,
    times: Times,
    names: Vec<String>,
    channels: Vec<Vec<f64>>,
}

impl Batch {
    fn new(channels: usize) -> Self {
        let channels = vec![Vec::with_capacity(BATCH_ROWS); channels];
        Self { lines: Vec::with_capacity(BATCH_ROWS), channels, ..Self::default() }
    }
}

/// Times as they come. They stay integers as long as all of them are.
#[derive(Default)]
struct Times {
    integers: Vec<i64>,
    decimals: Vec<f64>,
}

impl Times {
    fn push(
        &mut self,
        text: &str,
        place: Place,
        column: &str,
        layout: CsvLayout,
    ) -> Result<(), RowError> {
        if self.decimals.is_empty() {
            if let Ok(time) = text.parse() {
                self.integers.push(time);
                return Ok(());
            }
            #[expect(clippy::cast_precision_loss, reason = "the file mixes them with decimals")]
            self.decimals.extend(self.integers.drain(..).map(|time| time as f64));
        }
        self.decimals.push(number(text, place, column, layout)?);
        Ok(())
    }

    /// The first `count` times.
    fn finish(mut self, count: usize) -> TimeColumn {
        if self.decimals.is_empty() {
            self.integers.truncate(count);
            TimeColumn::Integer(self.integers)
        } else {
            self.decimals.truncate(count);
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

/// Explains why the record after the line `before` cannot be read.
fn explained(error: csv::Error, before: u64) -> DecodeError {
    match error.kind() {
        csv::ErrorKind::Io(reason) if reason.to_string() == RECORD_TOO_LONG => {
            DecodeError::File(format!(
                "a line after line {before} has more than {MAX_RECORD_BYTES} bytes; is a quote in it \
                 never closed?"
            ))
        }
        _ => error.into(),
    }
}
