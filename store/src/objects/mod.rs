//! Objects: the bytes of shards, checkpoints, artifacts and uploads, behind the trait of
//! `object_store`.
//!
//! An object appears under its path whole or not at all, and on a local disk it is synced. Paths
//! carry the epoch of the lease under which they were written, so a worker that lost its lease
//! never overwrites a file that another worker committed.
//!
//! Parquet is read at positions, from a file. Local objects are files already: they are written and
//! opened in place. Remote objects are written to a file first, which is published when it is
//! whole, and they are copied to a file to be read. The cache keeps both kinds of files under their
//! digests.
//!
//! Every request that makes an object appear carries `If-None-Match: *`, so an object is never
//! replaced by another one in a store that honours conditions. After a refusal or a lost answer the
//! object is read back. The clock of the store that holds an object gives its age.
//!
//! While a store is open, every write and deletion looks for its mark first (`mark`). A sweep
//! deletes only names that `path` writes and reads, and only what an earlier sweep announced.

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
pub(crate) mod mark;
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
use futures::stream::BoxStream;
use futures::{StreamExt, TryStreamExt};
use object_store::local::LocalFileSystem;
use object_store::path::Path;
use object_store::{ObjectStore, ObjectStoreExt};

use crate::StoreError;
use crate::objects::checked::{CheckedObjects, Verdict};
use crate::objects::file::measure;
use crate::objects::mark::{Displaced, MarkWatch, Marker};
use crate::objects::path::MadeObject;
use crate::place::data_dir::DataDir;

pub use away::RemoteObjects;
pub(crate) use away::RemoteStore;
pub(crate) use cache::{UnfinishedCopy, is_made as is_cache_name};
pub use file::measure_file;
pub use fingerprint::{Fingerprint, StoredObject};
pub(crate) use path::unique_name;
pub use s3::{Patience, S3Options};
pub use signed::SignedFor;
pub(crate) use unfinished_file::UnfinishedLeftover;
pub use url::ObjectsUrl;
pub use writer::ObjectWriter;

/// An object, or a range of one, that is being downloaded.
pub struct ObjectBytes {
    /// Size of the whole object, in bytes.
    pub size: u64,
    /// The range of bytes that follow.
    pub range: Range<u64>,
    /// The bytes, in pieces. It ends with an error if they are not those of the row.
    pub stream: BoxStream<'static, Result<Bytes, StoreError>>,
}

#[derive(Debug)]
pub(crate) struct Objects {
    place: Backend,
    checked: CheckedObjects,
}

#[derive(Debug)]
enum Backend {
    Folder(Folder),
    Remote(RemoteStore),
}

/// Objects as files in a folder.
#[derive(Debug)]
struct Folder {
    path: PathBuf,
    local: LocalFileSystem,
    mark: MarkWatch,
}

impl Objects {
    /// Objects in the data folder.
    pub fn in_folder(dir: &DataDir) -> Result<Self, StoreError> {
        let local = LocalFileSystem::new_with_prefix(dir.objects())
            .map_err(|error| dir.unusable(io::Error::other(error)))?
            .with_fsync(true);
        Ok(Self::new(Backend::Folder(Folder {
            path: dir.objects(),
            local,
            mark: MarkWatch::default(),
        })))
    }

    /// Remote objects, with copies in the data folder.
    pub fn elsewhere(dir: &DataDir, objects: RemoteObjects) -> Result<Self, StoreError> {
        RemoteStore::new(dir, objects).map(|remote| Self::new(Backend::Remote(remote)))
    }

    fn new(place: Backend) -> Self {
        Self { place, checked: CheckedObjects::default() }
    }

    pub fn remote(&self) -> &dyn ObjectStore {
        match &self.place {
            Backend::Folder(folder) => &folder.local,
            Backend::Remote(remote) => &*remote.remote,
        }
    }

    /// The name of the place in errors.
    pub fn place(&self) -> String {
        match &self.place {
            Backend::Folder(folder) => folder.path.display().to_string(),
            Backend::Remote(remote) => remote.remote.to_string(),
        }
    }

    /// The folder, if objects are files.
    pub fn folder(&self) -> Option<&std::path::Path> {
        match &self.place {
            Backend::Folder(folder) => Some(&folder.path),
            Backend::Remote(_) => None,
        }
    }

    /// The remote objects, if objects are not files.
    pub fn away(&self) -> Option<&RemoteStore> {
        match &self.place {
            Backend::Folder(_) => None,
            Backend::Remote(remote) => Some(remote),
        }
    }

    /// Checks that an object exists before a row names it.
    pub async fn verify_published(&self, object: &StoredObject) -> Result<(), StoreError> {
        let found = self
            .remote()
            .head(&parse(&object.path)?)
            .await
            .map_err(StoreError::object("looking for it", &object.path))?;
        object.check_size(found.size)
    }

    /// Expects this mark at the place from now on.
    pub fn expect_mark(&self, marker: Marker) {
        match &self.place {
            Backend::Folder(folder) => folder.mark.expect(marker),
            Backend::Remote(remote) => remote.mark.expect(marker),
        }
    }

    /// The fault of the place that is known without waiting.
    pub fn displaced(&self) -> Option<Displaced> {
        match &self.place {
            Backend::Folder(folder) => folder.mark.look_in_folder(&folder.path),
            Backend::Remote(remote) => remote.displaced(),
        }
    }

    /// Checks before a write or a deletion that the place is still that of this store. For a bucket
    /// the last look may be some seconds old.
    ///
    /// # Errors
    /// [`StoreError::Displaced`] when the place has no mark or that of another store.
    pub async fn check_place(&self) -> Result<(), StoreError> {
        let found = match &self.place {
            Backend::Folder(folder) => folder.mark.look_in_folder(&folder.path),
            Backend::Remote(remote) if remote.mark.is_stale() => {
                remote.mark.look_at(&*remote.remote).await
            }
            Backend::Remote(remote) => remote.mark.known(),
        };
        found.map_or(Ok(()), |found| Err(self.displaced_error(found)))
    }

    /// Like [`Self::check_place`], with a look at a bucket that is not older than this call.
    pub async fn check_place_now(&self) -> Result<(), StoreError> {
        let found = match &self.place {
            Backend::Folder(folder) => folder.mark.look_in_folder(&folder.path),
            Backend::Remote(remote) => remote.mark.look_at(&*remote.remote).await,
        };
        found.map_or(Ok(()), |found| Err(self.displaced_error(found)))
    }

    /// Like [`Self::check_place`]. Blocks.
    pub fn check_place_blocking(&self) -> Result<(), StoreError> {
        match &self.place {
            Backend::Folder(folder) => {
                let found = folder.mark.look_in_folder(&folder.path);
                found.map_or(Ok(()), |found| Err(self.displaced_error(found)))
            }
            Backend::Remote(remote) => remote.block_on(self.check_place()),
        }
    }

    pub fn displaced_error(&self, found: Displaced) -> StoreError {
        StoreError::Displaced { place: self.place(), found: found.as_str() }
    }

    /// Deletes objects that no row names any more. If one cannot be deleted, the next sweep tries
    /// again.
    pub async fn delete(&self, paths: Vec<String>) {
        if paths.is_empty() {
            return;
        }
        if let Err(error) = self.check_place().await {
            tracing::warn!(count = paths.len(), %error, "objects are not deleted");
            return;
        }
        match &self.place {
            Backend::Folder(folder) => {
                for path in paths {
                    match delete_file(&folder.local, &path).await {
                        Ok(()) => folder.delete_if_empty(&path),
                        Err(error) => tracing::warn!(path, %error, "cannot delete an object"),
                    }
                }
            }
            Backend::Remote(remote) => remote.delete(paths).await,
        }
    }

    /// The first paths besides the store's own marks and the objects that only test the place, at
    /// most `limit` of them.
    pub async fn first(&self, limit: usize) -> Result<Vec<String>, StoreError> {
        let is_other = |path: &str| {
            !path::is_mark(path) && MadeObject::of_path(path) != Some(MadeObject::Probe)
        };
        self.remote()
            .list(None)
            .map_ok(|object| object.location.to_string())
            .try_filter(|path| std::future::ready(is_other(path)))
            .take(limit)
            .try_collect()
            .await
            .map_err(StoreError::object("listing", "objects"))
    }

    /// The paths of all objects, of whoever made them, that may be marks of stores below this one.
    pub async fn marks_below(&self) -> Result<Vec<String>, StoreError> {
        let ending = format!("/{}", path::MARKER);
        self.remote()
            .list(None)
            .map_ok(|object| object.location.to_string())
            .try_filter(|path| std::future::ready(path.ends_with(&ending)))
            .try_collect()
            .await
            .map_err(StoreError::object("listing", "objects"))
    }

    /// The paths and sizes of objects that were published before `limit`. Files of others at the
    /// place are not among them.
    pub async fn older_than(&self, limit: SystemTime) -> Result<Vec<(String, u64)>, StoreError> {
        self.remote()
            .list(None)
            .try_filter(|object| {
                let is_old = SystemTime::from(object.last_modified) < limit;
                let is_made = || MadeObject::of_path(object.location.as_ref()).is_some();
                std::future::ready(is_old && is_made())
            })
            .map_ok(|object| (object.location.to_string(), object.size))
            .try_collect()
            .await
            .map_err(StoreError::object("listing", "objects"))
    }

    /// The current time, by the clock that dates objects.
    pub async fn now(&self) -> Result<SystemTime, StoreError> {
        match &self.place {
            Backend::Folder(_) => Ok(SystemTime::now()),
            Backend::Remote(remote) => remote.now().await,
        }
    }

    /// Unfinished files of this machine that are older than `age` and that no process writes.
    pub async fn unfinished(&self, age: Duration) -> Result<Vec<UnfinishedLeftover>, StoreError> {
        let (folder, cache) = match &self.place {
            Backend::Folder(folder) => (Some(folder.path.clone()), None),
            Backend::Remote(remote) => (None, Some(remote.cache.clone())),
        };
        let find = move || match (folder, cache) {
            (Some(folder), _) => unfinished_file::find_below(&folder, age),
            (None, Some(cache)) => cache.leftovers(age),
            (None, None) => Ok(Vec::new()),
        };
        let found = tokio::task::spawn_blocking(find).await;
        found
            .map_err(io::Error::other)
            .flatten()
            .map_err(StoreError::file("looking for unfinished files in", "the folder of objects"))
    }

    /// Deletes unfinished files unless a process writes them by now. Returns how many it deleted.
    pub async fn delete_unfinished(&self, files: Vec<PathBuf>) -> Result<u64, StoreError> {
        let delete = move || files.iter().map(|file| unfinished_file::delete(file)).sum::<u64>();
        let deleted = tokio::task::spawn_blocking(delete).await;
        let failed = StoreError::file("deleting unfinished files in", "the folder of objects");
        deleted.map_err(|error| failed(io::Error::other(error)))
    }

    /// Opens an object for blocking reads after checking its digest, which reads all of it once. A
    /// file that this process has checked before and that did not change is not read again.
    pub fn open_verified(&self, object: &StoredObject) -> Result<File, StoreError> {
        let folder = match &self.place {
            Backend::Folder(folder) => folder,
            Backend::Remote(remote) => return remote.open_verified(object, &self.checked),
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

    /// Opens an object for blocking reads, without checking its bytes.
    pub fn open(&self, path: &str) -> Result<File, StoreError> {
        match &self.place {
            Backend::Folder(folder) => folder.open(path),
            Backend::Remote(remote) => remote.open(path),
        }
    }

    /// Reads an object to learn its size and digest, without checking them. Blocks.
    pub fn measure(&self, path: &str) -> Result<StoredObject, StoreError> {
        match &self.place {
            Backend::Folder(folder) => measure(&folder.open(path)?, path),
            Backend::Remote(remote) => remote.measure(path),
        }
    }
}

impl Folder {
    fn open(&self, path: &str) -> Result<File, StoreError> {
        let location = parse(path)?;
        File::open(self.path.join(location.as_ref())).map_err(StoreError::file("opening", path))
    }

    /// Deletes the folder of a checkpoint after its last file. No other checkpoint uses that
    /// folder. Other folders are shared, and somebody may be about to write there.
    fn delete_if_empty(&self, path: &str) {
        if path::is_of_checkpoint(path)
            && let Some(parent) = self.path.join(path).parent()
        {
            // This fails while the folder holds other files of the checkpoint.
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
