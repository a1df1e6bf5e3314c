//! Parts of a file, read from their beginning to their end.

use std::io::{self, Read};
use std::sync::Arc;

use bytes::Bytes;
use crc32fast::Hasher;
use parquet::file::reader::ChunkReader;

/// Number of bytes that are read from the file at once.
const READ_BYTES: u64 = 64 * 1024;

/// A part of a file. Several sections of one file can be read in turns, because each knows its
/// place.
pub(super) struct Section<R> {
    file: Arc<R>,
    at: u64,
    end: u64,
    read: Bytes,
}

impl<R: ChunkReader> Section<R> {
    /// The bytes from `start` to `start + length`, or to the end of the file.
    pub fn new(file: Arc<R>, start: u64, length: u64) -> Self {
        let end = start.saturating_add(length).min(file.len());
        Self { file, at: start, end, read: Bytes::new() }
    }
}

impl<R: ChunkReader> Read for Section<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.read.is_empty() && self.at < self.end {
            let length = (self.end - self.at).min(READ_BYTES);
            let count = usize::try_from(length).map_err(io::Error::other)?;
            self.read = self.file.get_bytes(self.at, count).map_err(io::Error::other)?;
            self.at += length;
        }
        let count = buffer.len().min(self.read.len());
        buffer[..count].copy_from_slice(&self.read.split_to(count));
        Ok(count)
    }
}

/// Bytes whose checksum is compared at their end.
pub(super) struct Summed<R> {
    inner: R,
    hasher: Hasher,
    /// CRC-32 of all bytes; 0 for one that nobody wrote.
    expected: u32,
}

impl<R> Summed<R> {
    pub fn new(inner: R, expected: u32) -> Self {
        Self { inner, hasher: Hasher::new(), expected }
    }
}

impl<R: Read> Read for Summed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hasher.update(&buffer[..count]);
        let is_end = count == 0 && !buffer.is_empty();
        if is_end && self.expected != 0 && self.hasher.clone().finalize() != self.expected {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "its checksum is wrong"));
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_are_read_in_turns_and_end_where_they_should() {
        let file = Arc::new(Bytes::from((0..=255).cycle().take(200_000).collect::<Vec<u8>>()));
        let mut first = Section::new(Arc::clone(&file), 10, 100_000);
        let mut second = Section::new(Arc::clone(&file), 199_990, u64::MAX);
        let mut bytes = [0; 4];
        first.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes, file[10..14]);
        let mut rest = Vec::new();
        assert_eq!(second.read_to_end(&mut rest).unwrap(), 10);
        rest.clear();
        first.read_to_end(&mut rest).unwrap();
        assert_eq!(rest, file[14..100_010]);
        assert_eq!(Section::new(file, 300_000, 5).read(&mut bytes).unwrap(), 0);
    }

    #[test]
    fn a_checksum_is_compared_at_the_end() {
        let read = |expected| {
            let mut text = String::new();
            Summed::new(&b"123456789"[..], expected).read_to_string(&mut text)
        };
        // The check value of CRC-32.
        assert!(read(0xcbf4_3926).is_ok() && read(0).is_ok());
        assert!(read(1).unwrap_err().to_string().contains("checksum"));
    }
}
