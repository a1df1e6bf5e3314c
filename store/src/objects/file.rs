//! Files of objects, for blocking reads.

use std::fs::File;
use std::io::{self, Read};
use std::sync::Arc;

use bytes::Bytes;
use sha2::{Digest as _, Sha256};
use spec::Digest;

use crate::{StoreError, StoredObject};

/// Like [`Store::measure_object`](crate::Store::measure_object), for a file in a folder.
///
/// # Errors
/// When it does not exist or cannot be read.
pub fn measure_file(folder: &std::path::Path, name: &str) -> Result<StoredObject, StoreError> {
    let file = File::open(folder.join(name)).map_err(StoreError::file("opening", name))?;
    measure(&file, name)
}

pub(crate) fn measure(file: &File, path: &str) -> Result<StoredObject, StoreError> {
    let failed = || StoreError::file("reading", path);
    let sha256 = digest_of(file).map_err(failed())?;
    let size = file.metadata().map_err(failed())?.len();
    Ok(StoredObject { path: path.to_owned(), size, sha256 })
}

fn digest_of(mut file: &File) -> io::Result<Digest> {
    let mut buffer = vec![0; 1 << 20];
    let mut digest = Sha256::new();
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(Digest::from_bytes(digest.finalize().into())),
            read => digest.update(&buffer[..read]),
        }
    }
}

/// The file of an object. It is read at positions, so threads can share it.
#[derive(Clone, Debug)]
pub(crate) struct PositionedFile {
    file: Arc<File>,
    size: u64,
}

impl PositionedFile {
    pub fn new(file: File) -> io::Result<Self> {
        let size = file.metadata()?.len();
        Ok(Self { file: Arc::new(file), size })
    }
}

impl parquet::file::reader::Length for PositionedFile {
    fn len(&self) -> u64 {
        self.size
    }
}

impl parquet::file::reader::ChunkReader for PositionedFile {
    type T = io::BufReader<FromPosition>;

    fn get_read(&self, start: u64) -> parquet::errors::Result<Self::T> {
        Ok(io::BufReader::new(FromPosition { file: self.clone(), position: start }))
    }

    fn get_bytes(&self, start: u64, length: usize) -> parquet::errors::Result<Bytes> {
        use std::os::unix::fs::FileExt;
        let mut bytes = vec![0; length];
        self.file.read_exact_at(&mut bytes, start)?;
        Ok(bytes.into())
    }
}

#[derive(Debug)]
pub(crate) struct FromPosition {
    file: PositionedFile,
    position: u64,
}

impl Read for FromPosition {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        use std::os::unix::fs::FileExt;
        let count = self.file.file.read_at(buffer, self.position)?;
        self.position += count as u64;
        Ok(count)
    }
}
