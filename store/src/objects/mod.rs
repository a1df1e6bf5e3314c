//! Objects: the bytes of shards, checkpoints, artifacts and uploads, behind the trait of
//! `object_store`.
//!
//! An object appears under its path whole and, on a local disk, synced, or not at all. Paths carry the
//! epoch of the lease under which they were written, so that a worker that lost its lease never
//! overwrites what another one committed.
//!
//! Parquet is read at positions, from a file. Objects of a local folder are files already: they are
//! written and opened in place. Those that lie elsewhere are written to a file, which is published when it is
//! whole, and copied to a file to be read; the cache keeps both kinds of files under their digests.

mod access;
mod answers;
mod away;
mod cache;
mod checked;
mod client;
mod copy;
mod download;
mod fetch;
pub(crate) mod file;
mod fingerprint;
pub mod path;
mod probe;
mod publish;
mod s3;
mod signed;
pub(crate) mod trouble;
mod unfinished_file;
mod url;
mod writer;

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use bytes::Bytes;
use futures::TryStreamExt;
use futures::stream::BoxStream;
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt};
use spec::Digest;

use crate::StoreError;
use crate::data_dir::DataDir;
use crate::objects::checked::{CheckedObjects, Verdict};
use crate::objects::file::measure;

pub(crate) use away::Elsewhere;
pub use away::RemoteObjects;
pub(crate) use cache::UnfinishedCopy;
pub use file::measure_file;
pub use fingerprint::Fingerprint;
pub use s3::{Patience, S3Options};
pub use signed::SignedFor;
pub use url::ObjectsUrl;
pub use writer::ObjectWriter;
pub(crate) use writer::unique_name;

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
    place: Place,
    checked: CheckedObjects,
}

#[derive(Debug)]
enum Place {
    Folder(Folder),
    Elsewhere(Elsewhere),
}

/// Objects as files below a folder.
#[derive(Debug)]
struct Folder {
    path: PathBuf,
    local: LocalFileSystem,
}

impl Objects {
    /// In the data folder.
    pub fn in_folder(dir: &DataDir) -> Result<Self, StoreError> {
        let local = LocalFileSystem::new_with_prefix(dir.objects())
            .map_err(|error| dir.unusable(io::Error::other(error)))?
            .with_fsync(true);
        Ok(Self::new(Place::Folder(Folder { path: dir.objects(), local })))
    }

    /// Elsewhere, with copies in the data folder.
    pub fn elsewhere(dir: &DataDir, objects: RemoteObjects) -> Result<Self, StoreError> {
        Elsewhere::new(dir, objects).map(|elsewhere| Self::new(Place::Elsewhere(elsewhere)))
    }

    fn new(place: Place) -> Self {
        Self { place, checked: CheckedObjects::default() }
    }

    pub fn remote(&self) -> &dyn ObjectStore {
        match &self.place {
            Place::Folder(folder) => &folder.local,
            Place::Elsewhere(elsewhere) => &*elsewhere.remote,
        }
    }

    /// As errors name it.
    pub fn place(&self) -> String {
        match &self.place {
            Place::Folder(folder) => folder.path.display().to_string(),
            Place::Elsewhere(elsewhere) => elsewhere.remote.to_string(),
        }
    }

    /// Where objects lie as files, if they do.
    pub fn folder(&self) -> Option<&std::path::Path> {
        match &self.place {
            Place::Folder(folder) => Some(&folder.path),
            Place::Elsewhere(_) => None,
        }
    }

    /// Where objects lie that are no files, if they do.
    pub fn away(&self) -> Option<&Elsewhere> {
        match &self.place {
            Place::Folder(_) => None,
            Place::Elsewhere(elsewhere) => Some(elsewhere),
        }
    }

    /// Makes sure that an object is there before a row says so.
    pub async fn verify_published(&self, object: &StoredObject) -> Result<(), StoreError> {
        let found = self
            .remote()
            .head(&parse(&object.path)?)
            .await
            .map_err(StoreError::object("looking for it", &object.path))?;
        object.check_size(found.size)
    }

    /// Deletes objects that no row names any more. Those that cannot be deleted are left to the
    /// next sweep.
    pub async fn delete(&self, paths: Vec<String>) {
        match &self.place {
            Place::Folder(folder) => {
                for path in paths {
                    match delete_file(&folder.local, &path).await {
                        Ok(()) => folder.delete_if_empty(&path),
                        Err(error) => tracing::warn!(path, %error, "cannot delete an object"),
                    }
                }
            }
            Place::Elsewhere(elsewhere) => elsewhere.delete(paths).await,
        }
    }

    /// The path of an object, if there is one beside the store's own marks.
    pub async fn any(&self) -> Result<Option<String>, StoreError> {
        let mut listed = self.remote().list(None);
        let failed = || StoreError::object("listing", "objects");
        while let Some(object) = listed.try_next().await.map_err(failed())? {
            if !path::is_mark(object.location.as_ref()) {
                return Ok(Some(object.location.to_string()));
            }
        }
        Ok(None)
    }

    /// The paths and sizes of all objects that were published before `limit`, without the store's own marks.
    pub async fn older_than(&self, limit: SystemTime) -> Result<Vec<(String, u64)>, StoreError> {
        self.remote()
            .list(None)
            .try_filter(|object| {
                let is_old = SystemTime::from(object.last_modified) < limit;
                std::future::ready(is_old && !path::is_mark(object.location.as_ref()))
            })
            .map_ok(|object| (object.location.to_string(), object.size))
            .try_collect()
            .await
            .map_err(StoreError::object("listing", "objects"))
    }

    /// Now, by the clock that says when objects were published.
    pub async fn now(&self) -> Result<SystemTime, StoreError> {
        match &self.place {
            Place::Folder(_) => Ok(SystemTime::now()),
            Place::Elsewhere(elsewhere) => elsewhere.now().await,
        }
    }

    /// Deletes files that somebody began to write `age` ago; returns how many. The cache deletes its own.
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
        let folder = match &self.place {
            Place::Folder(folder) => folder,
            Place::Elsewhere(elsewhere) => return elsewhere.open_verified(object, &self.checked),
        };
        let head = futures::executor::block_on(folder.local.head(&parse(&object.path)?));
        let version = head.map_err(StoreError::object("looking for it", &object.path))?;
        object.check_size(version.size)?;
        let file = folder.open(&object.path)?;
        if self.checked.verdict(object, &version) == Some(Verdict::Sound) {
            return Ok(file);
        }
        self.checked.judge(object, &version, measure(&file, &object.path)?.sha256)?;
        rewind(file, &object.path)
    }

    /// Opens an object for blocking reads, whatever its bytes are.
    pub fn open(&self, path: &str) -> Result<File, StoreError> {
        match &self.place {
            Place::Folder(folder) => folder.open(path),
            Place::Elsewhere(elsewhere) => elsewhere.open(path),
        }
    }

    /// Reads all of an object's bytes to learn their size and digest, whatever they are. Blocks.
    pub fn measure(&self, path: &str) -> Result<StoredObject, StoreError> {
        match &self.place {
            Place::Folder(folder) => measure(&folder.open(path)?, path),
            Place::Elsewhere(elsewhere) => elsewhere.measure(path),
        }
    }
}

impl Folder {
    fn open(&self, path: &str) -> Result<File, StoreError> {
        let location = parse(path)?;
        File::open(self.path.join(location.as_ref())).map_err(StoreError::file("opening", path))
    }

    /// Deletes the folder of a checkpoint when its last file is gone: no other checkpoint has it. Folders of other
    /// objects are shared, and somebody may be about to write there.
    fn delete_if_empty(&self, path: &str) {
        if path::is_of_checkpoint(path)
            && let Some(parent) = self.path.join(path).parent()
        {
            // It is not empty while other files of the checkpoint are there.
            let _ = std::fs::remove_dir(parent);
        }
    }
}

async fn delete_file(local: &LocalFileSystem, path: &str) -> Result<(), StoreError> {
    let deleted = local.delete(&parse(path)?).await;
    deleted.map_err(StoreError::object("deleting", path))
}

fn rewind(mut file: File, path: &str) -> Result<File, StoreError> {
    io::Seek::rewind(&mut file).map_err(StoreError::file("opening", path))?;
    Ok(file)
}

fn parse(path: &str) -> Result<Path, StoreError> {
    Path::parse(path).map_err(|error| StoreError::object("parsing its path", path)(error.into()))
}
