//! How objects are written and read.

use std::fs::File;
use std::io::{self, Seek, SeekFrom};
use std::ops::Range;

use bytes::Bytes;
use futures::stream::BoxStream;
use futures::{StreamExt, TryStreamExt};
use object_store::{GetOptions, GetRange, GetResultPayload, ObjectStoreExt};
use spec::Digest;
use tokio_util::io::ReaderStream;

use crate::objects::file::measure;
use crate::objects::{OTHER_DIGEST, damaged, parse};
use crate::{ObjectBytes, ObjectWriter, Store, StoreError, StoredObject};

impl Store {
    /// Publishes `bytes` under `path`.
    ///
    /// # Errors
    /// When the disk is full or fails; nothing lies under `path` then.
    pub async fn put_object(&self, path: &str, bytes: Bytes) -> Result<StoredObject, StoreError> {
        let object = StoredObject {
            path: path.to_owned(),
            size: bytes.len() as u64,
            sha256: Digest::of(&bytes),
        };
        self.objects()
            .remote()
            .put(&parse(path)?, bytes.into())
            .await
            .map_err(StoreError::object("writing", path))?;
        Ok(object)
    }

    /// Begins an object that is written piece by piece.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub async fn write_object(&self, path: &str) -> Result<ObjectWriter, StoreError> {
        let path = parse(path)?.to_string();
        match self.objects().folder() {
            Some(folder) => {
                let folder = folder.to_owned();
                let failed = StoreError::file("writing", &path);
                tokio::task::spawn_blocking(move || ObjectWriter::in_store(&folder, &path))
                    .await
                    .map_err(|error| failed(io::Error::other(error)))?
            }
            None => ObjectWriter::elsewhere(self.objects().remote(), &path).await,
        }
    }

    /// Reads an object whole and checks its digest.
    ///
    /// # Errors
    /// When it cannot be read, or has not the bytes that were published.
    pub async fn read_object(&self, object: &StoredObject) -> Result<Bytes, StoreError> {
        let bytes = self
            .objects()
            .remote()
            .get(&parse(&object.path)?)
            .await
            .map_err(StoreError::object("reading", &object.path))?
            .bytes()
            .await
            .map_err(StoreError::object("reading", &object.path))?;
        if Digest::of(&bytes) != object.sha256 {
            return Err(damaged(object, OTHER_DIGEST.to_owned()));
        }
        Ok(bytes)
    }

    /// Streams an object, or `range` of it, as downloads do.
    ///
    /// # Errors
    /// When it cannot be opened, or `range` is not in it.
    pub async fn open_object(
        &self,
        path: &str,
        range: Option<Range<u64>>,
    ) -> Result<ObjectBytes, StoreError> {
        let failed = || StoreError::object("reading", path);
        let options = GetOptions { range: range.map(GetRange::Bounded), ..GetOptions::default() };
        let found =
            self.objects().remote().get_opts(&parse(path)?, options).await.map_err(failed())?;
        let (size, range) = (found.meta.size, found.range.clone());
        let stream = match found.payload {
            GetResultPayload::File(file, _) => stream_file(file, &range).map_err(failed())?,
            GetResultPayload::Stream(stream) => stream,
        };
        let path = path.to_owned();
        let stream = stream.map_err(move |error| StoreError::object("reading", &path)(error));
        Ok(ObjectBytes { size, range, stream: stream.boxed() })
    }

    /// Reads all of an object's bytes to learn their size and digest, whatever they were. Blocks.
    ///
    /// # Errors
    /// When it is not there or cannot be read.
    pub fn measure_object(&self, path: &str) -> Result<StoredObject, StoreError> {
        measure(&self.objects().open(path)?, path)
    }
}

/// Bytes per piece of a download. The stream that object_store makes of a file takes 8 KiB at a
/// time, each on a thread of its own.
const DOWNLOAD_PIECE: usize = 256 * 1024;

fn stream_file(
    mut file: File,
    range: &Range<u64>,
) -> Result<BoxStream<'static, object_store::Result<Bytes>>, object_store::Error> {
    use tokio::io::AsyncReadExt;
    let generic = |source: io::Error| object_store::Error::Generic {
        store: "LocalFileSystem",
        source: Box::new(source),
    };
    file.seek(SeekFrom::Start(range.start)).map_err(generic)?;
    let part = tokio::fs::File::from_std(file).take(range.end - range.start);
    Ok(ReaderStream::with_capacity(part, DOWNLOAD_PIECE).map_err(generic).boxed())
}
