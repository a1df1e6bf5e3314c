//! Rows of an MCAP file, the format of ROS 2's bags: one for each message of type
//! `sensor_msgs/JointState` on one topic.
//!
//! The file is read from its beginning to its end, record by record. An index is not needed.

use std::collections::HashMap;
use std::io::{self, ErrorKind, Read};
use std::sync::Arc;

use lz4_flex::frame::FrameDecoder;
use parquet::file::reader::ChunkReader;
use spec::{ImportSpec, TimeUnit};

use super::DecodeError;
use super::joint_state::JointState;
use super::mcap_columns::{Columns, Time};
use super::section::{Section, Summed};
use crate::error::{Place, RowError};
use crate::rows::{MAX_BATCH_ROWS, Rows, TimeColumn};

/// Number of messages that are read at once.
const BATCH_ROWS: usize = 1024;
const _: () = assert!(BATCH_ROWS <= MAX_BATCH_ROWS);

const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// The opcode of a record and the length of its content.
const HEAD_BYTES: usize = 9;

const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const DATA_END: u8 = 15;
const FOOTER: u8 = 2;

/// The longest record that is read into memory. Records of other topics are skipped.
const MAX_RECORD_BYTES: u64 = 1 << 20;

/// The names of the type in ROS 2 and in older bags.
const TYPES: [&str; 2] = ["sensor_msgs/msg/JointState", "sensor_msgs/JointState"];

pub(super) struct McapRows<R> {
    file: Arc<R>,
    /// Place of the next record of the file.
    at: u64,
    /// The records of a chunk that is being read.
    chunk: Option<Box<dyn Read>>,
    is_over: bool,
    schemas: HashMap<u16, String>,
    /// The topics of all channels.
    topics: HashMap<u16, String>,
    /// The channels whose messages are rows.
    chosen: Vec<u16>,
    /// The topic that is read: the requested one, or the only one.
    topic: Option<String>,
    columns: Columns,
    next_row: u64,
}

/// A record: its opcode, and the reader of its content.
struct Record {
    opcode: u8,
    length: u64,
}

fn damaged(reason: impl std::fmt::Display) -> DecodeError {
    DecodeError::File(format!("it is not a whole MCAP file: {reason}"))
}

impl<R: ChunkReader + 'static> McapRows<R> {
    /// # Errors
    /// When the file is not MCAP, or the columns are not those of a message.
    pub fn open(file: R, spec: &ImportSpec) -> Result<Self, DecodeError> {
        let file = Arc::new(file);
        let mut magic = [0; MAGIC.len()];
        let mut start = Section::new(Arc::clone(&file), 0, MAGIC.len() as u64);
        if start.read_exact(&mut magic).is_err() || magic != MAGIC {
            return Err(DecodeError::File("it is not an MCAP file".to_owned()));
        }
        Ok(Self {
            file,
            at: MAGIC.len() as u64,
            chunk: None,
            is_over: false,
            schemas: HashMap::new(),
            topics: HashMap::new(),
            chosen: Vec::new(),
            topic: spec.mcap.topic.clone(),
            columns: Columns::of(spec)?,
            next_row: 0,
        })
    }

    /// The next rows; `None` at the end.
    ///
    /// # Errors
    /// When the file is damaged, has no such messages, or a message lacks a joint.
    pub fn next(&mut self) -> Result<Option<Rows>, DecodeError> {
        let mut rows = Rows { first: self.next_row, ..Rows::default() };
        rows.channels = vec![Vec::new(); self.columns.joints.len() * self.columns.quantities.len()];
        let mut times = Vec::new();
        while rows.count < BATCH_ROWS && !self.is_over {
            self.read_record(&mut rows, &mut times)?;
        }
        if self.is_over && self.chosen.is_empty() {
            return Err(self.no_topic());
        }
        let has_rows = self.next_row > 0 || rows.count > 0;
        if self.is_over
            && !has_rows
            && let Some(error) = self.columns.no_joint()
        {
            return Err(error);
        }
        self.next_row += rows.count as u64;
        rows.time = self.columns.time.map(|_| TimeColumn::Dated(times, TimeUnit::Ns));
        Ok((rows.count > 0).then_some(rows))
    }

    fn no_topic(&self) -> DecodeError {
        let mut topics: Vec<&str> = self.topics.values().map(String::as_str).collect();
        topics.sort_unstable();
        topics.dedup();
        topics.truncate(50);
        let wanted = match &self.topic {
            Some(topic) => format!("messages of type {} on the topic {topic:?}", TYPES[0]),
            None => format!("messages of type {}", TYPES[0]),
        };
        DecodeError::File(format!("it has no {wanted}; its topics are {}", topics.join(", ")))
    }

    /// Reads a record of the chunk, or of the file.
    fn read_record(&mut self, rows: &mut Rows, times: &mut Vec<i64>) -> Result<(), DecodeError> {
        if let Some(mut chunk) = self.chunk.take() {
            let Some(Record { opcode, length }) = head(&mut chunk)? else { return Ok(()) };
            self.take_record(opcode, length, &mut chunk, rows, times)?;
            self.chunk = Some(chunk);
            return Ok(());
        }
        let mut file = Section::new(Arc::clone(&self.file), self.at, HEAD_BYTES as u64);
        let Some(Record { opcode, length }) = head(&mut file)? else {
            return Err(damaged("its end is missing, as if its writer was stopped"));
        };
        let content_at = self.at + HEAD_BYTES as u64;
        let left = self.file.len() - content_at;
        if length > left {
            return Err(damaged(format!(
                "a record of {length} bytes begins {left} before the end"
            )));
        }
        self.at = content_at + length;
        let mut content = Section::new(Arc::clone(&self.file), content_at, length);
        match opcode {
            DATA_END | FOOTER => self.is_over = true,
            CHUNK => self.chunk = Some(open_chunk(content)?),
            SCHEMA | CHANNEL | MESSAGE => {
                self.take_record(opcode, length, &mut content, rows, times)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes a record whose content is at the beginning of `records`.
    fn take_record(
        &mut self,
        opcode: u8,
        length: u64,
        records: &mut dyn Read,
        rows: &mut Rows,
        times: &mut Vec<i64>,
    ) -> Result<(), DecodeError> {
        let mut content = records.take(length);
        match opcode {
            SCHEMA => {
                let record = whole(&mut content)?;
                let mut fields = Fields(&record);
                let schema = fields.number::<2>().zip(fields.text());
                let (id, name) = schema.ok_or_else(|| damaged("a schema is damaged"))?;
                self.schemas.insert(u16::from_le_bytes(id), name);
            }
            CHANNEL => {
                let record = whole(&mut content)?;
                self.take_channel(&record)?;
            }
            MESSAGE => {
                let mut head = [0; 2];
                content.read_exact(&mut head).map_err(damaged)?;
                if self.chosen.contains(&u16::from_le_bytes(head)) {
                    let message = whole(&mut content)?;
                    self.take_message(&message, rows, times)?;
                }
            }
            _ => {}
        }
        let skipped = content.limit();
        let read = io::copy(&mut content, &mut io::sink()).map_err(damaged)?;
        if read < skipped {
            return Err(damaged("a record of a chunk is longer than the chunk"));
        }
        Ok(())
    }

    fn take_channel(&mut self, record: &[u8]) -> Result<(), DecodeError> {
        let mut fields = Fields(record);
        let ids = fields.number::<2>().zip(fields.number::<2>());
        let texts = fields.text().zip(fields.text());
        let Some(((id, schema), (topic, encoding))) = ids.zip(texts) else {
            return Err(damaged("a channel is damaged"));
        };
        let (id, schema) = (u16::from_le_bytes(id), u16::from_le_bytes(schema));
        let is_joint_state =
            self.schemas.get(&schema).is_some_and(|name| TYPES.contains(&name.as_str()));
        self.topics.insert(id, topic.clone());
        let is_wanted = self.topic.as_ref().is_none_or(|wanted| *wanted == topic);
        if !is_joint_state || self.chosen.contains(&id) {
            return Ok(());
        }
        if !is_wanted {
            let others = match &self.topic {
                // The spec names no topic, so the first one was taken.
                Some(first) if self.columns.is_any_topic => first,
                _ => return Ok(()),
            };
            return Err(DecodeError::File(format!(
                "it has messages of type {} on the topics {others:?} and {topic:?}; name one in mcap.topic",
                TYPES[0]
            )));
        }
        if encoding != "cdr" {
            return Err(DecodeError::File(format!(
                "messages on the topic {topic:?} have the encoding {encoding:?}, allowed: \"cdr\", as ROS 2 \
                 writes it"
            )));
        }
        self.topic = Some(topic);
        self.chosen.push(id);
        Ok(())
    }

    /// Takes a message without the number of its channel.
    fn take_message(
        &mut self,
        record: &[u8],
        rows: &mut Rows,
        times: &mut Vec<i64>,
    ) -> Result<(), DecodeError> {
        let mut fields = Fields(record);
        let numbers = fields.number::<4>().zip(fields.number::<8>().zip(fields.number::<8>()));
        let Some((_, (log, publish))) = numbers else {
            return Err(damaged("a message is damaged"));
        };
        let place = Place::Row(rows.first + rows.count as u64 + 1);
        let message = JointState::of(fields.0).map_err(|reason| {
            DecodeError::File(format!("the message of {place} is damaged: {reason}"))
        })?;
        self.columns.find_joints(&message, place)?;
        let Some((_, Some(places))) = &self.columns.places else { return Ok(()) };
        let time = match self.columns.time {
            Some(Time::Log) => i64::from_le_bytes(log),
            Some(Time::Publish) => i64::from_le_bytes(publish),
            Some(Time::Stamp) | None => message.stamp_ns,
        };
        times.push(time);
        let mut channels = rows.channels.iter_mut();
        for quantity in &self.columns.quantities {
            let values = quantity.of(&message);
            if values.len() != message.names.len() {
                let found = format!("{} values", values.len());
                let allowed = format!("{}, one for each name of the message", message.names.len());
                return Err(RowError::value(place, quantity.name(), found, allowed).into());
            }
            for (at, channel) in places.iter().zip(channels.by_ref()) {
                channel.push(values[*at]);
            }
        }
        rows.count += 1;
        Ok(())
    }
}

/// The opcode and the length of the next record; `None` at the end.
fn head(records: &mut impl Read) -> Result<Option<Record>, DecodeError> {
    let mut head = [0; HEAD_BYTES];
    let mut read = 0;
    while read < HEAD_BYTES {
        match records.read(&mut head[read..]) {
            Ok(0) if read == 0 => return Ok(None),
            Ok(0) => return Err(damaged("it was cut off within a record")),
            Ok(more) => read += more,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(damaged(error)),
        }
    }
    let [opcode, length @ ..] = head;
    Ok(Some(Record { opcode, length: u64::from_le_bytes(length) }))
}

/// The rest of a record.
fn whole(content: &mut io::Take<&mut dyn Read>) -> Result<Vec<u8>, DecodeError> {
    if content.limit() > MAX_RECORD_BYTES {
        let bytes = content.limit();
        return Err(damaged(format!("a record has {bytes} bytes, allowed: {MAX_RECORD_BYTES}")));
    }
    let mut bytes = Vec::new();
    content.read_to_end(&mut bytes).map_err(damaged)?;
    Ok(bytes)
}

/// The records in a chunk.
fn open_chunk<R: ChunkReader + 'static>(
    mut content: Section<R>,
) -> Result<Box<dyn Read>, DecodeError> {
    // The times of the first and the last message, and the length without compression.
    let mut head = [0; 8 + 8 + 8];
    let (mut crc, mut length) = ([0; 4], [0; 4]);
    let mut read = |bytes: &mut [u8]| content.read_exact(bytes).map_err(damaged);
    read(&mut head)?;
    read(&mut crc)?;
    read(&mut length)?;
    let mut compression = vec![0; (u32::from_le_bytes(length) as usize).min(64)];
    read(&mut compression)?;
    let mut records = [0; 8];
    read(&mut records)?;
    let crc = u32::from_le_bytes(crc);
    let records = content.take(u64::from_le_bytes(records));
    Ok(match compression.as_slice() {
        b"" => Box::new(Summed::new(records, crc)),
        b"zstd" => {
            let decoder = zstd::stream::read::Decoder::new(records).map_err(damaged)?;
            Box::new(Summed::new(decoder, crc))
        }
        b"lz4" => Box::new(Summed::new(FrameDecoder::new(records), crc)),
        other => {
            let name = String::from_utf8_lossy(other);
            return Err(DecodeError::File(format!(
                "its chunks are compressed with {name:?}, allowed: none, zstd, lz4"
            )));
        }
    })
}

/// The fields of a record, little-endian.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (number, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*number)
    }

    fn text(&mut self) -> Option<String> {
        let length = usize::try_from(u32::from_le_bytes(self.number()?)).ok()?;
        let (text, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(String::from_utf8_lossy(text).into_owned())
    }
}
