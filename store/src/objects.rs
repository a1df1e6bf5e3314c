//! Objects: the bytes of shards, checkpoints and artifacts.
//!
//! An object appears under its path whole and synced to disk, or not at all. Paths carry the
//! epoch of the lease under which they were written, so that a worker that lost its lease never
//! overwrites what another one committed.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use bytes::Bytes;
use futures::stream::BoxStream;
use futures::{StreamExt, TryStreamExt};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{GetOptions, GetRange, GetResultPayload, ObjectStore, ObjectStoreExt};
use sha2::{Digest as _, Sha256};
use spec::Digest;
use tokio_util::io::ReaderStream;

use crate::data_dir::DataDir;
use crate::{ObjectWriter, Store, StoreError};

/// Where the objects of each kind lie.
pub mod object_path {
    use spec::Digest;

    use crate::{Epoch, FileContent, JobId, RunId};

    pub fn shard(job: JobId, ordinal: u32, epoch: Epoch, content: FileContent) -> String {
        format!("datasets/{job}/shard-{ordinal:05}-e{epoch}-{content}.parquet")
    }

    pub fn checkpoint(job: JobId, step: u64, epoch: Epoch, name: &str) -> String {
        format!("checkpoints/{job}/step-{step:08}-e{epoch}/{name}")
    }

    /// An artifact may be written again under the same lease, so its digest is in its path.
    pub fn artifact(run: RunId, epoch: Epoch, digest: &Digest, name: &str) -> String {
        format!("runs/{run}/{}-e{epoch}-{name}", digest.short())
    }

    /// A table of a run is written once under a lease, and its digest is known at its end only.
    pub fn table(run: RunId, epoch: Epoch, name: &str) -> String {
        format!("runs/{run}/table-e{epoch}-{name}")
    }
}

/// An object that was published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredObject {
    /// Within the store, or within the folder it was written to.
    pub path: String,
    /// In bytes.
    pub size: u64,
    pub sha256: Digest,
}

/// An object, or a range of it, as it is downloaded.
pub struct ObjectBytes {
    /// Of the whole object, in bytes.
    pub size: u64,
    /// The bytes that follow.
    pub range: Range<u64>,
    pub stream: BoxStream<'static, Result<Bytes, StoreError>>,
}

#[derive(Debug)]
pub(crate) struct Objects {
    root: PathBuf,
    local: Arc<LocalFileSystem>,
}

impl Objects {
    pub fn open(dir: &DataDir) -> Result<Self, StoreError> {
        let local = LocalFileSystem::new_with_prefix(dir.objects())
            .map_err(|error| dir.unusable(io::Error::other(error)))?
            .with_fsync(true);
        Ok(Self { root: dir.objects(), local: Arc::new(local) })
    }

    pub fn root(&self) -> &std::path::Path {
        &self.root
    }

    pub fn local(&self) -> &LocalFileSystem {
        &self.local
    }

    /// Makes sure that an object is there before a row says so.
    pub async fn verify_published(&self, object: &StoredObject) -> Result<(), StoreError> {
        let found = self
            .local
            .head(&parse(&object.path)?)
            .await
            .map_err(StoreError::object("looking for it", &object.path))?;
        if found.size == object.size {
            return Ok(());
        }
        Err(damaged(object, format!("it has {} bytes instead of {}", found.size, object.size)))
    }

    /// Deletes objects that no row names any more. Those that cannot be deleted are left to the
    /// next sweep.
    pub async fn delete(&self, paths: Vec<String>) {
        for path in paths {
            let deleted = match parse(&path) {
                Ok(location) => self.local.delete(&location).await.map_err(|e| e.to_string()),
                Err(error) => Err(error.to_string()),
            };
            if let Err(error) = deleted {
                tracing::warn!(path, error, "cannot delete an object");
            }
        }
    }

    /// Opens an object for blocking reads, having read all of it once to check its digest.
    pub fn open_verified(&self, object: &StoredObject) -> Result<File, StoreError> {
        let file = self.open_file(&object.path)?;
        let digest = digest_of(&file).map_err(|source| StoreError::ObjectFile {
            operation: "checking",
            path: object.path.clone(),
            source,
        })?;
        if digest != object.sha256 {
            return Err(damaged(object, OTHER_DIGEST.to_owned()));
        }
        Ok(file)
    }

    pub fn open_file(&self, path: &str) -> Result<File, StoreError> {
        let file = self
            .local
            .path_to_filesystem(&parse(path)?)
            .map_err(StoreError::object("opening", path))?;
        File::open(file).map_err(|source| StoreError::ObjectFile {
            operation: "opening",
            path: path.to_owned(),
            source,
        })
    }
}

fn parse(path: &str) -> Result<Path, StoreError> {
    Path::parse(path).map_err(|error| StoreError::object("parsing its path", path)(error.into()))
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

const OTHER_DIGEST: &str = "it has not the digest it was published with";

fn damaged(object: &StoredObject, detail: String) -> StoreError {
    StoreError::ObjectFile {
        operation: "checking",
        path: object.path.clone(),
        source: io::Error::new(io::ErrorKind::InvalidData, detail),
    }
}

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
            .local
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
        let root = self.objects().root.clone();
        let path = parse(path)?.to_string();
        let failed = StoreError::file("writing", &path);
        tokio::task::spawn_blocking(move || ObjectWriter::in_store(&root, &path))
            .await
            .map_err(|error| failed(io::Error::other(error)))?
    }

    /// Reads an object whole and checks its digest.
    ///
    /// # Errors
    /// When it cannot be read, or has not the bytes that were published.
    pub async fn read_object(&self, object: &StoredObject) -> Result<Bytes, StoreError> {
        let bytes = self
            .objects()
            .local
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
        let found = self.objects().local.get_opts(&parse(path)?, options).await.map_err(failed())?;
        let (size, range) = (found.meta.size, found.range.clone());
        let stream = match found.payload {
            GetResultPayload::File(file, _) => stream_file(file, &range).map_err(failed())?,
            GetResultPayload::Stream(stream) => stream,
        };
        let path = path.to_owned();
        let stream = stream.map_err(move |error| StoreError::object("reading", &path)(error));
        Ok(ObjectBytes { size, range, stream: stream.boxed() })
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

impl Store {
    /// Reads all of an object's bytes to learn their size and digest, whatever they were. Blocks.
    ///
    /// # Errors
    /// When it is not there or cannot be read.
    pub fn measure_object(&self, path: &str) -> Result<StoredObject, StoreError> {
        measure(&self.objects().open_file(path)?, path)
    }
}

/// As [`Store::measure_object`], for a file of a folder.
///
/// # Errors
/// When it is not there or cannot be read.
pub fn measure_file(folder: &std::path::Path, name: &str) -> Result<StoredObject, StoreError> {
    let file = File::open(folder.join(name)).map_err(StoreError::file("opening", name))?;
    measure(&file, name)
}

fn measure(file: &File, path: &str) -> Result<StoredObject, StoreError> {
    let failed = || StoreError::file("reading", path);
    let sha256 = digest_of(file).map_err(failed())?;
    let size = file.metadata().map_err(failed())?.len();
    Ok(StoredObject { path: path.to_owned(), size, sha256 })
}

/// An object's file, read at positions so that threads can share it.
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
