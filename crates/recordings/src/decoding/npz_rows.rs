//! Rows of a NumPy archive: arrays of one length, whose rows are read together.

use std::io::{self, Read};
use std::ops::Range;

use arrow_array::types::{ArrowPrimitiveType, Float16Type};
use parquet::file::reader::ChunkReader;
use spec::{ImportSpec, TimeUnit};

use super::DecodeError;
use super::zip::Archive;
use crate::error::{Place, RowError};
use crate::rows::{MAX_BATCH_ROWS, MAX_NAME_BYTES, Rows, TimeColumn, check_name};
use crate::selection::{MAX_ELEMENTS, find_elements};

type Half = <Float16Type as ArrowPrimitiveType>::Native;

/// Number of rows that are read at once.
const BATCH_ROWS: usize = 1024;
const _: () = assert!(BATCH_ROWS <= MAX_BATCH_ROWS);

const MAGIC: &[u8] = b"\x93NUMPY";

/// The longest header of an array. Those of plain arrays have 128 bytes.
const MAX_HEADER_BYTES: u32 = 16 * 1024;

/// The largest number of rows.
const MAX_ROWS: u64 = 1_000_000_000;

/// The ending of a member that is an array.
const ENDING: &str = ".npy";

pub(super) struct NpzRows {
    time: Option<Array>,
    recording: Option<Array>,
    channels: Vec<Array>,
    rows: u64,
    next_row: u64,
}

/// An array of numbers or texts, read row by row.
struct Array {
    name: String,
    element: Element,
    /// Number of elements per row.
    columns: usize,
    /// The elements of each row that are read.
    chosen: Range<usize>,
    content: Box<dyn Read>,
}

/// The type of an element.
#[derive(Clone, Copy)]
struct Element {
    kind: Kind,
    bytes: usize,
    is_big_endian: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Float,
    Signed,
    Unsigned,
    /// A date or a duration.
    Dated(TimeUnit),
    /// A text of UTF-32.
    Text,
}

/// The header of an array.
struct Header {
    element: Element,
    is_column_major: bool,
    shape: Vec<u64>,
}

impl NpzRows {
    /// # Errors
    /// When the file is no archive, an array is missing, or arrays have unsuitable shapes or types.
    pub fn open<R: ChunkReader + 'static>(file: R, spec: &ImportSpec) -> Result<Self, DecodeError> {
        let archive = Archive::open(file)?;
        let members = archive.names();
        let names: Vec<&str> =
            members.iter().filter_map(|name| name.strip_suffix(ENDING)).collect();
        let found = find_elements(spec, &names).map_err(DecodeError::File)?;
        let mut rows = None;
        let mut opened =
            Self { time: None, recording: None, channels: Vec::new(), rows: 0, next_row: 0 };
        for ((field, _), selected) in spec.columns.named().into_iter().zip(found) {
            let name = names[selected.place];
            let refused = |found: &str, allowed: &str| {
                let what = format!("array {name:?} (columns.{field})");
                DecodeError::File(format!("{what} {found}, allowed: {allowed}"))
            };
            let quantity = field.trim_end_matches("[0]");
            let expected = if spec.has_one_column(quantity) { spec.joints() } else { 1 };
            let mut content = archive.member(&format!("{name}{ENDING}"))?;
            let Header { element, is_column_major, shape } = read_header(&mut content)
                .map_err(|reason| refused(&reason, "an array of numbers"))?;
            let (count, columns) = shape_of(&shape, selected.elements.as_ref(), expected)
                .map_err(|allowed| refused(&format!("has the shape {shape:?}"), &allowed))?;
            let chosen = selected.elements.unwrap_or(0..columns);
            if *rows.get_or_insert(count) != count {
                let allowed = format!("{} as the others", rows.unwrap_or_default());
                return Err(refused(&format!("has {count} rows"), &allowed));
            }
            let is_right = match (field.as_str(), element.kind) {
                ("recording", Kind::Signed | Kind::Unsigned | Kind::Text) => true,
                ("recording", _) => return Err(refused("has another type", "integers or text")),
                ("time", Kind::Dated(unit)) => [unit, TimeUnit::S].contains(&spec.units.time),
                (_, Kind::Float | Kind::Signed | Kind::Unsigned) => true,
                _ => return Err(refused("has another type", "integers or floats")),
            };
            if !is_right {
                return Err(refused("has times with a unit", "no other units.time"));
            }
            let name = name.to_owned();
            let array = |content, columns, chosen| {
                let name = name.clone();
                Array { name, element, columns, chosen, content }
            };
            let mut arrays = Vec::new();
            if is_column_major && columns > 1 {
                // Each column begins after all rows of those before.
                for column in chosen {
                    let mut content = archive.member(&format!("{name}{ENDING}"))?;
                    read_header(&mut content).map_err(DecodeError::File)?;
                    let before = column as u64 * count * element.bytes as u64;
                    io::copy(&mut content.by_ref().take(before), &mut io::sink())
                        .map_err(|error| ended(&name, &error))?;
                    arrays.push(array(content, 1, 0..1));
                }
            } else {
                arrays.push(array(content, columns, chosen));
            }
            match field.as_str() {
                "time" => opened.time = arrays.pop(),
                "recording" => opened.recording = arrays.pop(),
                _ => opened.channels.extend(arrays),
            }
        }
        opened.rows = rows.unwrap_or_default();
        Ok(opened)
    }

    /// The next rows; `None` at the end.
    ///
    /// # Errors
    /// When an array ends too early, or its checksum is wrong.
    pub fn next(&mut self) -> Result<Option<Rows>, DecodeError> {
        let left = usize::try_from(self.rows - self.next_row).unwrap_or(usize::MAX);
        let count = left.min(BATCH_ROWS);
        let arrays = self.time.iter_mut().chain(&mut self.recording).chain(&mut self.channels);
        if count == 0 {
            // The checksum is compared where nothing follows.
            for array in arrays {
                array.check_end()?;
            }
            return Ok(None);
        }
        let first = self.next_row;
        self.next_row += count as u64;
        let time = self.time.as_mut().map(|array| array.times(count)).transpose()?;
        let recording =
            self.recording.as_mut().map(|array| array.names(count, first)).transpose()?;
        let mut channels = Vec::new();
        for array in &mut self.channels {
            channels.extend(array.floats(count)?);
        }
        Ok(Some(Rows { first, count, time, recording, channels, ..Rows::default() }))
    }
}

/// The number of rows and of elements in each of an array with `expected` elements in a row, or with
/// those that the spec names. The error says what is allowed.
fn shape_of(
    shape: &[u64],
    named: Option<&Range<usize>>,
    expected: usize,
) -> Result<(u64, usize), String> {
    let (rows, columns) = match shape {
        [rows] if named.is_none() => (*rows, 1),
        [rows, columns] => (*rows, usize::try_from(*columns).unwrap_or(usize::MAX)),
        _ => (u64::MAX, 0),
    };
    let is_right = match named {
        None => columns == expected,
        Some(named) => (named.end..=MAX_ELEMENTS).contains(&columns),
    };
    if is_right && rows <= MAX_ROWS {
        return Ok((rows, columns));
    }
    Err(match (named, expected) {
        (Some(named), _) => {
            format!("the shape (rows, columns) with {} to {MAX_ELEMENTS} columns", named.end)
        }
        (None, 1) => "one number per row".to_owned(),
        (None, joints) if rows <= MAX_ROWS && columns > joints => format!(
            "the shape (rows, {joints}), one column for each joint; name columns with [0], or a range with \
             [0:{joints}]"
        ),
        (None, joints) => format!("the shape (rows, {joints})"),
    })
}

fn ended(name: &str, error: &io::Error) -> DecodeError {
    DecodeError::File(format!("its array {name:?} cannot be read to its end: {error}"))
}

impl Array {
    /// The bytes of the next rows.
    fn bytes(&mut self, rows: usize) -> Result<Vec<u8>, DecodeError> {
        let mut bytes = vec![0; rows * self.columns * self.element.bytes];
        self.content.read_exact(&mut bytes).map_err(|error| ended(&self.name, &error))?;
        if self.element.is_big_endian {
            let unit = if self.element.kind == Kind::Text { 4 } else { self.element.bytes };
            bytes.chunks_exact_mut(unit).for_each(<[u8]>::reverse);
        }
        Ok(bytes)
    }

    fn check_end(&mut self) -> Result<(), DecodeError> {
        // Columns of an array in the order of columns are followed by others.
        let read = io::copy(&mut self.content, &mut io::sink());
        read.map(drop).map_err(|error| ended(&self.name, &error))
    }

    /// The next rows, one list per column.
    fn floats(&mut self, rows: usize) -> Result<Vec<Vec<f64>>, DecodeError> {
        let bytes = self.bytes(rows)?;
        let element = self.element;
        let mut channels = vec![Vec::with_capacity(rows); self.chosen.len()];
        for row in bytes.chunks_exact(element.bytes * self.columns) {
            let chosen = row.chunks_exact(element.bytes).skip(self.chosen.start);
            for (channel, bytes) in channels.iter_mut().zip(chosen) {
                channel.push(element.float(bytes));
            }
        }
        Ok(channels)
    }

    fn times(&mut self, rows: usize) -> Result<TimeColumn, DecodeError> {
        let element = self.element;
        if element.kind == Kind::Float {
            let values = self.floats(rows)?.pop().unwrap_or_default();
            return Ok(TimeColumn::Decimal(values));
        }
        let bytes = self.bytes(rows)?;
        let elements = bytes.chunks_exact(element.bytes).skip(self.chosen.start);
        let integers = elements.step_by(self.columns).map(|bytes| element.integer(bytes));
        let times: Option<Vec<i64>> = integers.collect();
        let times = times.ok_or_else(|| {
            DecodeError::File("its times do not fit into 64 bits with a sign".to_owned())
        })?;
        Ok(match element.kind {
            Kind::Dated(unit) => TimeColumn::Dated(times, unit),
            _ => TimeColumn::Integer(times),
        })
    }

    fn names(&mut self, rows: usize, first: u64) -> Result<Vec<String>, DecodeError> {
        let bytes = self.bytes(rows)?;
        let element = self.element;
        let mut names = Vec::with_capacity(rows);
        for (row, bytes) in (first + 1..).zip(bytes.chunks_exact(element.bytes)) {
            let place = Place::Row(row);
            let name = match element.kind {
                Kind::Text => text(bytes).ok_or_else(|| {
                    RowError::value(place, &self.name, "no text", "characters of Unicode")
                })?,
                _ => element.written(bytes),
            };
            check_name(&name, place, &self.name)?;
            names.push(name);
        }
        Ok(names)
    }
}

/// A text of UTF-32 that ends with zeros.
fn text(bytes: &[u8]) -> Option<String> {
    let codes = bytes.as_chunks().0.iter().map(|code| u32::from_le_bytes(*code));
    codes.take_while(|code| *code != 0).map(char::from_u32).collect()
}

impl Element {
    /// The type that NumPy writes as `descr`, such as `<f8`.
    fn of(descr: &str) -> Result<Self, String> {
        let unknown = || format!("has the type {descr:?}");
        let order = descr.chars().next().ok_or_else(unknown)?;
        let (kind, rest) =
            descr.get(1..).and_then(|rest| rest.split_at_checked(1)).ok_or_else(unknown)?;
        let (size, unit) = rest.split_once('[').unwrap_or((rest, ""));
        let size: usize = size.parse().map_err(|_| unknown())?;
        let unit =
            TimeUnit::ALL.into_iter().find(|known| unit.strip_suffix(']') == Some(known.as_str()));
        let (kind, bytes) = match (kind, size) {
            ("f", 2 | 4 | 8) => (Kind::Float, size),
            ("i", 1 | 2 | 4 | 8) => (Kind::Signed, size),
            ("u", 1 | 2 | 4 | 8) => (Kind::Unsigned, size),
            ("M" | "m", 8) => (Kind::Dated(unit.ok_or_else(unknown)?), size),
            ("U", 1..=MAX_NAME_BYTES) => (Kind::Text, 4 * size),
            _ => return Err(unknown()),
        };
        Ok(Self { kind, bytes, is_big_endian: order == '>' })
    }

    /// The eight bytes of a little-endian integer, with its sign.
    fn extended(self, bytes: &[u8]) -> [u8; 8] {
        let is_negative =
            self.kind != Kind::Unsigned && bytes.last().is_some_and(|last| last & 0x80 > 0);
        let mut whole = if is_negative { [0xff; 8] } else { [0; 8] };
        whole[..bytes.len()].copy_from_slice(bytes);
        whole
    }

    /// An integer; `None` beyond 64 bits with a sign.
    fn integer(self, bytes: &[u8]) -> Option<i64> {
        let whole = self.extended(bytes);
        match self.kind {
            Kind::Unsigned => i64::try_from(u64::from_le_bytes(whole)).ok(),
            _ => Some(i64::from_le_bytes(whole)),
        }
    }

    fn written(self, bytes: &[u8]) -> String {
        let whole = self.extended(bytes);
        match self.kind {
            Kind::Unsigned => u64::from_le_bytes(whole).to_string(),
            _ => i64::from_le_bytes(whole).to_string(),
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "integers with more than 53 bits are rounded")]
    fn float(self, bytes: &[u8]) -> f64 {
        match (self.kind, bytes) {
            (Kind::Float, [a, b]) => Half::from_le_bytes([*a, *b]).to_f64(),
            (Kind::Float, [a, b, c, d]) => f32::from_le_bytes([*a, *b, *c, *d]).into(),
            (Kind::Float, bytes) => bytes.try_into().map_or(f64::NAN, f64::from_le_bytes),
            (Kind::Unsigned, bytes) => u64::from_le_bytes(self.extended(bytes)) as f64,
            (_, bytes) => i64::from_le_bytes(self.extended(bytes)) as f64,
        }
    }
}

/// Reads the header of an array (NumPy's format 1, 2 or 3). The error says what the array is.
fn read_header(content: &mut impl Read) -> Result<Header, String> {
    let damaged = |error: io::Error| format!("has a damaged header ({error})");
    let mut start = [0; 8];
    content.read_exact(&mut start).map_err(damaged)?;
    if !start.starts_with(MAGIC) {
        return Err("is no array".to_owned());
    }
    let mut length = [0; 4];
    let bytes = if start[6] == 1 { 2 } else { 4 };
    content.read_exact(&mut length[..bytes]).map_err(damaged)?;
    let length = u32::from_le_bytes(length);
    if length > MAX_HEADER_BYTES {
        return Err(format!("has a header of {length} bytes"));
    }
    let mut header = vec![0; length as usize];
    content.read_exact(&mut header).map_err(damaged)?;
    let header = String::from_utf8_lossy(&header);
    let after = |key: &str| {
        let rest = header.split_once(&format!("'{key}':")).map(|(_, rest)| rest.trim_start());
        rest.ok_or_else(|| format!("has a header without {key:?}"))
    };
    let descr = after("descr")?;
    let quoted = descr.strip_prefix('\'').and_then(|rest| rest.split_once('\''));
    let (descr, _) = quoted.ok_or("has a type of several fields")?;
    let shape = after("shape")?;
    let shape = shape.strip_prefix('(').and_then(|rest| rest.split_once(')'));
    let (shape, _) = shape.ok_or("has a header without a shape")?;
    let shape = shape.split(',').map(str::trim).filter(|size| !size.is_empty());
    let shape = shape.map(|size| size.parse::<u64>().map_err(|_| format!("has the size {size:?}")));
    Ok(Header {
        element: Element::of(descr)?,
        is_column_major: after("fortran_order")?.starts_with("True"),
        shape: shape.collect::<Result<_, _>>()?,
    })
}
