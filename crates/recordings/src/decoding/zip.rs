//! The members of a ZIP archive, as `numpy.savez` writes it: stored or deflated, and with 64-bit
//! fields.

use std::collections::HashMap;
use std::io::Read;
use std::sync::Arc;

use bytes::Bytes;
use flate2::read::DeflateDecoder;
use parquet::file::reader::ChunkReader;

use super::DecodeError;
use super::section::{Section, Summed};

const END: &[u8] = b"PK\x05\x06";
const END_BYTES: usize = 22;
const END_64_PLACE: &[u8] = b"PK\x06\x07";
const END_64_PLACE_BYTES: u64 = 20;
const END_64: &[u8] = b"PK\x06\x06";
const MEMBER: &[u8] = b"PK\x01\x02";
const MEMBER_BYTES: usize = 46;
const LOCAL: &[u8] = b"PK\x03\x04";
const LOCAL_BYTES: usize = 30;

/// The longest comment at the end of an archive.
const MAX_COMMENT_BYTES: u64 = 65_535;

/// The largest directory that is read: arrays by the ten thousands.
const MAX_DIRECTORY_BYTES: u64 = 1 << 20;

/// In a field of 32 bits: the number is in a field of 64 bits.
const ELSEWHERE: u64 = u32::MAX as u64;

/// A ZIP archive.
pub(super) struct Archive<R> {
    file: Arc<R>,
    members: HashMap<String, Member>,
}

#[derive(Clone, Copy)]
struct Member {
    is_encrypted: bool,
    method: u64,
    crc: u32,
    compressed: u64,
    header: u64,
}

fn damaged(reason: &str) -> DecodeError {
    DecodeError::File(format!("it is not a whole ZIP archive: {reason}"))
}

/// The little-endian number of `bytes` bytes at this place.
fn number(content: &[u8], place: usize, bytes: usize) -> Option<u64> {
    let content = content.get(place..place.checked_add(bytes)?)?;
    Some(content.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte)))
}

fn place(number: u64) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

fn bytes<R: ChunkReader>(file: &R, start: u64, length: u64) -> Result<Bytes, DecodeError> {
    let end = start.checked_add(length).filter(|end| *end <= file.len());
    end.ok_or_else(|| damaged("it was cut off"))?;
    Ok(file.get_bytes(start, place(length))?)
}

impl<R: ChunkReader + 'static> Archive<R> {
    /// # Errors
    /// When the directory of the archive cannot be read.
    pub fn open(file: R) -> Result<Self, DecodeError> {
        let file = Arc::new(file);
        let length = file.len().min(END_BYTES as u64 + MAX_COMMENT_BYTES);
        let tail_at = file.len() - length;
        let tail = bytes(&*file, tail_at, length)?;
        let end = tail.windows(END.len()).rposition(|window| window == END);
        let end = end.ok_or_else(|| damaged("its end is missing"))?;
        let field = |place: usize, bytes: usize| number(&tail, end + place, bytes);
        let (Some(mut size), Some(mut start)) = (field(12, 4), field(16, 4)) else {
            return Err(damaged("its end is missing"));
        };
        if start == ELSEWHERE || size == ELSEWHERE {
            (size, start) = large_end(&*file, tail_at + end as u64)?;
        }
        if size > MAX_DIRECTORY_BYTES {
            return Err(damaged(&format!("its directory has {size} bytes")));
        }
        let directory = bytes(&*file, start, size)?;
        let members = members(&directory).ok_or_else(|| damaged("its directory is damaged"))?;
        Ok(Self { file, members })
    }

    /// The names of all members.
    pub fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.members.keys().map(String::as_str).collect();
        names.sort_unstable();
        names
    }

    /// The content of a member.
    ///
    /// # Errors
    /// When there is none of this name, or it is encrypted or compressed in another way.
    pub fn member(&self, name: &str) -> Result<Box<dyn Read>, DecodeError> {
        let Some(member) = self.members.get(name) else {
            return Err(damaged(&format!("it has no {name:?}")));
        };
        if member.is_encrypted {
            return Err(damaged(&format!("{name:?} is encrypted")));
        }
        let local = bytes(&*self.file, member.header, LOCAL_BYTES as u64)?;
        let (Some(name_bytes), Some(extra)) = (number(&local, 26, 2), number(&local, 28, 2)) else {
            return Err(damaged("it was cut off"));
        };
        if !local.starts_with(LOCAL) {
            return Err(damaged(&format!("{name:?} is not where the directory says")));
        }
        let start = member.header + LOCAL_BYTES as u64 + name_bytes + extra;
        let content = Section::new(Arc::clone(&self.file), start, member.compressed);
        Ok(match member.method {
            0 => Box::new(Summed::new(content, member.crc)),
            8 => Box::new(Summed::new(DeflateDecoder::new(content), member.crc)),
            other => {
                let reason = format!("{name:?} has compression {other}, allowed: stored, deflated");
                return Err(damaged(&reason));
            }
        })
    }
}

/// Size and start of the directory in an archive with 64-bit fields, whose end is at `end`.
fn large_end<R: ChunkReader>(file: &R, end: u64) -> Result<(u64, u64), DecodeError> {
    let missing = || damaged("its end is missing");
    let place = end.checked_sub(END_64_PLACE_BYTES).ok_or_else(missing)?;
    let place = bytes(file, place, END_64_PLACE_BYTES)?;
    let large = number(&place, 8, 8).filter(|_| place.starts_with(END_64_PLACE));
    let large = bytes(file, large.ok_or_else(missing)?, 56)?;
    let fields = number(&large, 40, 8).zip(number(&large, 48, 8));
    fields.filter(|_| large.starts_with(END_64)).ok_or_else(missing)
}

fn members(mut directory: &[u8]) -> Option<HashMap<String, Member>> {
    let mut members = HashMap::new();
    while !directory.is_empty() {
        let field = |place: usize, bytes: usize| number(directory, place, bytes);
        if !directory.starts_with(MEMBER) {
            return None;
        }
        let [name, extra, comment] = [field(28, 2)?, field(30, 2)?, field(32, 2)?].map(place);
        let name_end = MEMBER_BYTES + name;
        let extra_end = name_end + extra;
        let name = String::from_utf8_lossy(directory.get(MEMBER_BYTES..name_end)?).into_owned();
        // 64-bit fields are there for the numbers that are elsewhere, in this order.
        let mut large = large_fields(directory.get(name_end..extra_end)?).into_iter();
        let mut of = |number: u64| match number {
            ELSEWHERE => large.next(),
            number => Some(number),
        };
        let (_, compressed, header) = (of(field(24, 4)?)?, of(field(20, 4)?)?, of(field(42, 4)?)?);
        let member = Member {
            is_encrypted: field(8, 2)? & 1 == 1,
            method: field(10, 2)?,
            crc: u32::try_from(field(16, 4)?).ok()?,
            compressed,
            header: Some(header).filter(|header| *header < u64::MAX / 2)?,
        };
        members.insert(name, member);
        directory = directory.get(extra_end + comment..)?;
    }
    Some(members)
}

/// The numbers of the extra field with 64-bit fields.
fn large_fields(mut extra: &[u8]) -> Vec<u64> {
    while let (Some(id), Some(size)) = (number(extra, 0, 2), number(extra, 2, 2)) {
        let end = 4 + place(size);
        let Some(content) = extra.get(4..end) else { break };
        if id == 1 {
            return (0..content.len() / 8).filter_map(|k| number(content, 8 * k, 8)).collect();
        }
        extra = &extra[end..];
    }
    Vec::new()
}
