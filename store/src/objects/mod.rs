//! Objects: the bytes of shards, checkpoints, artifacts and uploads, behind the trait of
//! `object_store`.
//!
//! An object appears under its path whole and, on a local disk, synced, or not at all. Paths carry the
//! epoch of the lease under which they were written, so that a worker that lost its lease never
//! overwrites what another one committed.
//!
//! Parquet is read at positions, from a file. Objects of a local folder are files already: they are
//! written and opened in place. Those that lie elsewhere are sent in parts and copied to a file of
//! their size, without a name, which is gone when it is closed.

mod access;
mod checked;
mod copy;
mod download;
pub(crate) mod file;
mod fingerprint;
pub mod path;
mod unfinished_file;
mod writer;

use std::fs::File;
use std::io::{self, Write};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use futures::TryStreamExt;
use futures::stream::BoxStream;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt};
use spec::Digest;
use tokio::runtime::Handle;

use crate::StoreError;
use crate::data_dir::DataDir;
use crate::objects::checked::{CheckedObjects, Verdict};
use crate::objects::file::measure;

pub use file::measure_file;
pub use fingerprint::Fingerprint;
pub use writer::ObjectWriter;
pub(crate) use writer::{PART_SIZE, PARTS_IN_FLIGHT, unique_name};

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
    /// Size of the whole object, in bytes.
    pub size: u64,
    /// The bytes that follow.
    pub range: Range<u64>,
    pub stream: BoxStream<'static, Result<Bytes, StoreError>>,
}

#[derive(Debug)]
pub(crate) struct Objects {
    remote: Arc<dyn ObjectStore>,
    place: Place,
    checked: CheckedObjects,
}

#[derive(Debug)]
enum Place {
    /// In this folder, as files.
    Folder(PathBuf),
    Elsewhere {
        /// The folder for copies.
        spool: PathBuf,
        /// Runtime that waits for the network while a thread blocks.
        runtime: Handle,
    },
}

impl Objects {
    /// In the data folder.
    pub fn in_folder(dir: &DataDir) -> Result<Self, StoreError> {
        let local = LocalFileSystem::new_with_prefix(dir.objects())
            .map_err(|error| dir.unusable(io::Error::other(error)))?
            .with_fsync(true);
        Ok(Self::new(Arc::new(local), Place::Folder(dir.objects())))
    }

    /// In `remote`, with copies in the data folder while they are read.
    pub fn elsewhere(dir: &DataDir, remote: Arc<dyn ObjectStore>) -> Self {
        let place = Place::Elsewhere { spool: dir.objects(), runtime: Handle::current() };
        Self::new(remote, place)
    }

    fn new(remote: Arc<dyn ObjectStore>, place: Place) -> Self {
        Self { remote, place, checked: CheckedObjects::default() }
    }

    pub fn remote(&self) -> &dyn ObjectStore {
        &*self.remote
    }

    /// As errors name it.
    pub fn place(&self) -> String {
        match &self.place {
            Place::Folder(folder) => folder.display().to_string(),
            Place::Elsewhere { .. } => self.remote.to_string(),
        }
    }

    /// Where objects lie as files, if they do.
    pub fn folder(&self) -> Option<&std::path::Path> {
        match &self.place {
            Place::Folder(folder) => Some(folder),
            Place::Elsewhere { .. } => None,
        }
    }

    /// Makes sure that an object is there before a row says so.
    pub async fn verify_published(&self, object: &StoredObject) -> Result<(), StoreError> {
        let found = self
            .remote
            .head(&parse(&object.path)?)
            .await
            .map_err(StoreError::object("looking for it", &object.path))?;
        object.check_size(found.size)
    }

    /// Deletes objects that no row names any more. Those that cannot be deleted are left to the
    /// next sweep.
    pub async fn delete(&self, paths: Vec<String>) {
        for path in paths {
            let deleted = match parse(&path) {
                Ok(location) => self.remote.delete(&location).await.map_err(|e| e.to_string()),
                Err(error) => Err(error.to_string()),
            };
            match deleted {
                Ok(()) => self.delete_empty_folder(&path),
                Err(error) => tracing::warn!(path, error, "cannot delete an object"),
            }
        }
    }

    /// Deletes the folder of a checkpoint when its last file is gone: no other checkpoint has it. Folders of other
    /// objects are shared, and somebody may be about to write there.
    fn delete_empty_folder(&self, path: &str) {
        let Some(folder) = self.folder().filter(|_| path::is_of_checkpoint(path)) else { return };
        if let Some(parent) = folder.join(path).parent() {
            // It is not empty while other files of the checkpoint are there.
            let _ = std::fs::remove_dir(parent);
        }
    }

    /// The paths of all objects that were published before `limit`, without the store's own mark.
    pub async fn older_than(&self, limit: SystemTime) -> Result<Vec<String>, StoreError> {
        self.remote
            .list(None)
            .try_filter(|object| {
                let is_old = SystemTime::from(object.last_modified) < limit;
                std::future::ready(is_old && object.location.as_ref() != path::MARKER)
            })
            .map_ok(|object| object.location.to_string())
            .try_collect()
            .await
            .map_err(StoreError::object("listing", "objects"))
    }

    /// Deletes files that somebody began to write `age` ago; returns how many. What is sent elsewhere
    /// in parts has no file.
    pub async fn delete_unfinished(&self, age: Duration) -> Result<u64, StoreError> {
        let Some(folder) = self.folder().map(std::path::Path::to_owned) else { return Ok(0) };
        let failed = StoreError::file("sweeping unfinished files in", "objects");
        let swept =
            tokio::task::spawn_blocking(move || unfinished_file::delete_below(&folder, age)).await;
        swept.map_err(io::Error::other).flatten().map_err(failed)
    }

    /// Opens an object for blocking reads, having read all of it once to check its digest. A file that this process
    /// has read before and that did not change since is not read again.
    pub fn open_verified(&self, object: &StoredObject) -> Result<File, StoreError> {
        if self.folder().is_none() {
            let file = self.open(&object.path)?;
            object.check_digest(measure(&file, &object.path)?.sha256)?;
            return rewind(file, &object.path);
        }
        let head = futures::executor::block_on(self.remote.head(&parse(&object.path)?));
        let version = head.map_err(StoreError::object("looking for it", &object.path))?;
        object.check_size(version.size)?;
        let file = self.open(&object.path)?;
        if self.checked.verdict(object, &version) == Some(Verdict::Sound) {
            return Ok(file);
        }
        self.checked.judge(object, &version, measure(&file, &object.path)?.sha256)?;
        rewind(file, &object.path)
    }

    /// Opens an object for blocking reads, whatever its bytes are.
    pub fn open(&self, path: &str) -> Result<File, StoreError> {
        let location = parse(path)?;
        match &self.place {
            Place::Folder(folder) => File::open(folder.join(location.as_ref()))
                .map_err(StoreError::file("opening", path)),
            Place::Elsewhere { spool, runtime } => {
                let copy = self.copy(&location, spool);
                // Threads of the runtime may block when they say so.
                tokio::task::block_in_place(|| runtime.block_on(copy))
            }
        }
    }

    /// A copy in a file without a name, which never outgrows the object.
    async fn copy(&self, location: &Path, spool: &std::path::Path) -> Result<File, StoreError> {
        let failed = || StoreError::object("reading", location.as_ref());
        let copying = || StoreError::file("copying", location.as_ref());
        let found = self.remote.get(location).await.map_err(failed())?;
        let mut left = found.meta.size;
        let mut file = unnamed_file(spool).map_err(copying())?;
        let mut pieces = found.into_stream();
        while let Some(piece) = pieces.try_next().await.map_err(failed())? {
            left = left.checked_sub(piece.len() as u64).ok_or_else(|| {
                copying()(io::Error::new(io::ErrorKind::InvalidData, "it is longer than it says"))
            })?;
            file.write_all(&piece).map_err(copying())?;
        }
        rewind(file, location.as_ref())
    }
}

/// A file that is gone when it is closed, or when its process dies.
fn unnamed_file(folder: &std::path::Path) -> io::Result<File> {
    let path = folder.join(unique_name("copy"));
    let file = File::options().read(true).write(true).create_new(true).open(&path)?;
    std::fs::remove_file(path)?;
    Ok(file)
}

fn rewind(mut file: File, path: &str) -> Result<File, StoreError> {
    io::Seek::rewind(&mut file).map_err(StoreError::file("opening", path))?;
    Ok(file)
}

fn parse(path: &str) -> Result<Path, StoreError> {
    Path::parse(path).map_err(|error| StoreError::object("parsing its path", path)(error.into()))
}
