//! Frames: rows on their way from the process that decodes a file to the process that uses them.
//!
//! A frame has its kind (1 byte), the length of its content (4 bytes), and the content. The content
//! is rows, nothing at the end of the file, or, as UTF-8, the reason why the file cannot be read.
//! Numbers are little-endian.

use std::io::{self, ErrorKind, Read, Write};

use spec::{FileFormat, ImportSpec, TimeUnit};

use crate::ImportError;
use crate::rows::{MAX_BATCH_ROWS, MAX_NAME_BYTES, Rows, TimeColumn, channel_count};

const ROWS: u8 = b'r';
const END: u8 = b'e';
const REFUSAL: u8 = b'x';

/// The kinds of times that have a unit.
const DATED: [(u8, TimeUnit); 4] =
    [(3, TimeUnit::S), (4, TimeUnit::Ms), (5, TimeUnit::Us), (6, TimeUnit::Ns)];

/// Largest number of bytes of a reason, because names of columns may have any length.
const MAX_REFUSAL_BYTES: usize = 16 * 1024;

pub(crate) fn write_rows(out: &mut impl Write, rows: &Rows) -> io::Result<()> {
    let mut content = Vec::new();
    content.extend(length(rows.count)?);
    if let Some(lines) = &rows.lines {
        content.extend(lines.iter().flat_map(|line| line.to_le_bytes()));
        content.extend(rows.cut_line.unwrap_or(0).to_le_bytes());
    }
    match &rows.time {
        None => content.push(0),
        Some(TimeColumn::Integer(times)) => {
            content.push(1);
            content.extend(times.iter().flat_map(|time| time.to_le_bytes()));
        }
        Some(TimeColumn::Decimal(times)) => {
            content.push(2);
            content.extend(times.iter().flat_map(|time| time.to_le_bytes()));
        }
        Some(TimeColumn::Dated(times, unit)) => {
            content.extend(DATED.iter().filter(|(_, other)| other == unit).map(|(kind, _)| *kind));
            content.extend(times.iter().flat_map(|time| time.to_le_bytes()));
        }
    }
    for name in rows.recording.iter().flatten() {
        content.extend(length(name.len())?);
        content.extend(name.as_bytes());
    }
    for channel in &rows.channels {
        content.extend(channel.iter().flat_map(|value| value.to_le_bytes()));
    }
    write_frame(out, ROWS, &content)
}

pub(crate) fn write_end(out: &mut impl Write) -> io::Result<()> {
    write_frame(out, END, &[])
}

pub(crate) fn write_refusal(out: &mut impl Write, reason: &str) -> io::Result<()> {
    let end = reason.floor_char_boundary(MAX_REFUSAL_BYTES);
    write_frame(out, REFUSAL, &reason.as_bytes()[..end])
}

fn write_frame(out: &mut impl Write, kind: u8, content: &[u8]) -> io::Result<()> {
    out.write_all(&[kind])?;
    out.write_all(&length(content.len())?)?;
    out.write_all(content)?;
    out.flush()
}

fn length(length: usize) -> io::Result<[u8; 4]> {
    u32::try_from(length).map(u32::to_le_bytes).map_err(io::Error::other)
}

/// The rows of a file, read from the frames of another process. It refuses lengths that the rows of
/// `spec` cannot have.
pub struct Frames<R> {
    frames: R,
    has_lines: bool,
    has_time: bool,
    has_names: bool,
    channels: usize,
    next_row: u64,
    is_over: bool,
}

impl<R: Read> Frames<R> {
    /// Reads the rows of a file that was sent for `spec`.
    pub fn new(frames: R, spec: &ImportSpec) -> Self {
        Self {
            frames,
            has_lines: spec.format == FileFormat::Csv,
            has_time: spec.columns.time.is_some(),
            has_names: spec.columns.recording.is_some(),
            channels: channel_count(spec),
            next_row: 0,
            is_over: false,
        }
    }

    fn next_rows(&mut self) -> Result<Option<Rows>, ImportError> {
        let kind = self.array::<1>()?[0];
        let length = u32::from_le_bytes(self.array()?) as usize;
        let limit = match kind {
            ROWS => self.longest_rows(),
            END => 0,
            REFUSAL => MAX_REFUSAL_BYTES,
            _ => return Err(malformed()),
        };
        if length > limit {
            return Err(malformed());
        }
        let mut content = vec![0; length];
        self.frames.read_exact(&mut content)?;
        match kind {
            ROWS => {
                let rows = self.rows(&content).ok_or_else(malformed)?;
                self.next_row += rows.count as u64;
                Ok(Some(rows))
            }
            END => Ok(None),
            _ => Err(ImportError::Undecodable(String::from_utf8_lossy(&content).into_owned())),
        }
    }

    fn array<const N: usize>(&mut self) -> io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.frames.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn longest_rows(&self) -> usize {
        let row = 8 + 8 + 4 + MAX_NAME_BYTES + 8 * self.channels;
        4 + 8 + 1 + MAX_BATCH_ROWS * row
    }

    fn rows(&self, content: &[u8]) -> Option<Rows> {
        let mut content = Content(content);
        let count = content.length().filter(|count| *count <= MAX_BATCH_ROWS)?;
        let (lines, cut_line) = match self.has_lines {
            true => (Some(content.numbers(count)?), content.numbers(1)?.first().copied()),
            false => (None, None),
        };
        let cut_line = cut_line.filter(|line| *line > 0);
        let time = match content.take(1)? {
            [0] if !self.has_time => None,
            [1] if self.has_time => Some(TimeColumn::Integer(content.numbers(count)?)),
            [2] if self.has_time => Some(TimeColumn::Decimal(content.numbers(count)?)),
            [kind] if self.has_time => {
                let (_, unit) = DATED.into_iter().find(|(other, _)| other == kind)?;
                Some(TimeColumn::Dated(content.numbers(count)?, unit))
            }
            _ => return None,
        };
        let recording = match self.has_names {
            true => Some((0..count).map(|_| content.name()).collect::<Option<_>>()?),
            false => None,
        };
        let channels = (0..self.channels).map(|_| content.numbers(count));
        let channels = channels.collect::<Option<_>>()?;
        let is_whole = content.0.is_empty();
        let first = self.next_row;
        let file = None;
        is_whole.then_some(Rows { file, first, count, lines, cut_line, time, recording, channels })
    }
}

impl<R: Read> Iterator for Frames<R> {
    type Item = Result<Rows, ImportError>;

    /// The next rows until the end of the file, or until an error: [`ImportError::Undecodable`]
    /// when the file cannot be read, [`ImportError::Pipe`] when the frames end early or are
    /// invalid.
    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over {
            return None;
        }
        let rows = self.next_rows();
        self.is_over = !matches!(rows, Ok(Some(_)));
        rows.transpose()
    }
}

fn malformed() -> ImportError {
    io::Error::new(ErrorKind::InvalidData, "the process that reads the file sent no frame").into()
}

/// The rest of a frame.
struct Content<'a>(&'a [u8]);

impl<'a> Content<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn length(&mut self) -> Option<usize> {
        let bytes = self.take(4)?.try_into().ok()?;
        usize::try_from(u32::from_le_bytes(bytes)).ok()
    }

    fn name(&mut self) -> Option<String> {
        let length = self.length().filter(|length| *length <= MAX_NAME_BYTES)?;
        String::from_utf8(self.take(length)?.to_vec()).ok()
    }

    fn numbers<T: Number>(&mut self, count: usize) -> Option<Vec<T>> {
        let (numbers, _) = self.take(8 * count)?.as_chunks();
        Some(numbers.iter().map(|bytes| T::from_bytes(*bytes)).collect())
    }
}

/// Numbers of eight bytes.
trait Number {
    fn from_bytes(bytes: [u8; 8]) -> Self;
}

impl Number for i64 {
    fn from_bytes(bytes: [u8; 8]) -> Self {
        Self::from_le_bytes(bytes)
    }
}

impl Number for u64 {
    fn from_bytes(bytes: [u8; 8]) -> Self {
        Self::from_le_bytes(bytes)
    }
}

impl Number for f64 {
    fn from_bytes(bytes: [u8; 8]) -> Self {
        Self::from_le_bytes(bytes)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn spec() -> ImportSpec {
        let names = |prefix: &str| (1..=7).map(|i| format!("{prefix}{i}")).collect::<Vec<_>>();
        let spec = json!({
            "file": "0".repeat(64), "format": "csv",
            "columns": {"time": "t", "recording": "arm", "u": names("u"), "q": names("q")},
        });
        serde_json::from_value(spec).unwrap()
    }

    fn rows(first: u64, names: &[&str]) -> Rows {
        let count = names.len();
        Rows {
            file: None,
            first,
            count,
            lines: Some((first + 2..).take(count).collect()),
            cut_line: (first > 0).then_some(9),
            time: Some(TimeColumn::Integer((0..count as i64).map(|k| i64::MAX - k).collect())),
            recording: Some(names.iter().map(|name| (*name).to_owned()).collect()),
            channels: (0..14).map(|channel| vec![f64::from(channel) + 0.1; count]).collect(),
        }
    }

    fn read(bytes: &[u8]) -> Result<Vec<Rows>, ImportError> {
        Frames::new(bytes, &spec()).collect()
    }

    #[test]
    fn rows_arrive_as_they_were_sent() {
        let mut bytes = Vec::new();
        let sent = [rows(0, &["arm 0", "", "ärmel"]), rows(3, &["x"; 2])];
        sent.iter().for_each(|rows| write_rows(&mut bytes, rows).unwrap());
        let mut decimal = rows(5, &["y"]);
        decimal.time = Some(TimeColumn::Decimal(vec![-0.0]));
        write_rows(&mut bytes, &decimal).unwrap();
        let mut dated = rows(6, &["z"]);
        dated.time = Some(TimeColumn::Dated(vec![7], TimeUnit::Us));
        write_rows(&mut bytes, &dated).unwrap();
        write_end(&mut bytes).unwrap();
        let [first, second] = sent;
        assert_eq!(read(&bytes).unwrap(), [first, second, decimal, dated]);
    }

    #[test]
    fn frames_that_are_cut_off_or_claim_too_much_are_refused() {
        let mut bytes = Vec::new();
        write_rows(&mut bytes, &rows(0, &["arm 0"])).unwrap();
        for end in 0..=bytes.len() {
            assert!(matches!(read(&bytes[..end]), Err(ImportError::Pipe(_))), "{end}");
        }
        for claim in [[ROWS, 0xff, 0xff, 0xff, 0xff], [REFUSAL, 0, 0, 1, 0], [b'?', 0, 0, 0, 0]] {
            assert!(matches!(read(&claim), Err(ImportError::Pipe(_))));
        }
        let mut more = bytes.clone();
        more[5] = 2;
        assert!(matches!(read(&more), Err(ImportError::Pipe(_))), "two rows with values of one");
    }

    #[test]
    fn a_reason_arrives_cut_to_a_length_that_people_read() {
        let mut bytes = Vec::new();
        write_refusal(&mut bytes, &"é".repeat(10_000)).unwrap();
        let reason = read(&bytes).unwrap_err().to_string();
        assert_eq!(reason, "é".repeat(MAX_REFUSAL_BYTES / 2));
    }
}
