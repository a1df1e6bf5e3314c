//! Health of the store: whether it can be written to, and whether there is room for more.

use std::fs::Metadata;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::sys::statvfs::statvfs;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::objects::RemoteStore;
use crate::{Store, StoreError};

/// Space on the disk of the data folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiskSpace {
    pub free_bytes: u64,
    /// Space kept free. With less, no task is claimed, because each one would fail.
    pub reserved_bytes: u64,
}

/// Keeps the end of the reserve free while a large object is written, because the database has to
/// say that the task found no room.
#[derive(Debug)]
pub(crate) struct LastRoom {
    folder: PathBuf,
    unlooked: usize,
}

/// Distinguishes a file from a later one with the same path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileIdentity {
    device: u64,
    inode: u64,
}

/// Space kept free on a large disk.
const RESERVED_BYTES: u64 = 256 << 20;

/// The fraction of a small disk that is kept free is 1 / `RESERVED_PART`.
const RESERVED_PART: u64 = 20;

/// Objects leave the last 1 / `LAST_PART` of the reserve to the database.
const LAST_PART: u64 = 4;

/// Number of written bytes after which the free space is looked at.
const LOOK_EVERY: usize = 1 << 20;

/// Time limit of a trivial write.
const WRITE_WITHIN: Duration = Duration::from_secs(2);

impl DiskSpace {
    #[allow(clippy::useless_conversion, reason = "on some systems these counts have 32 bits")]
    pub(crate) fn of(folder: &Path) -> io::Result<Self> {
        let system = statvfs(folder)?;
        let bytes = |blocks| u64::from(system.fragment_size()).saturating_mul(blocks);
        Ok(Self {
            free_bytes: bytes(u64::from(system.blocks_available())),
            reserved_bytes: RESERVED_BYTES.min(bytes(u64::from(system.blocks())) / RESERVED_PART),
        })
    }

    pub const fn is_low(&self) -> bool {
        self.free_bytes < self.reserved_bytes
    }

    /// Whether so little is left that the database needs it.
    const fn is_nearly_full(&self) -> bool {
        self.free_bytes < self.reserved_bytes / LAST_PART
    }
}

impl LastRoom {
    pub fn of(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), unlooked: 0 }
    }

    /// Call this before a write of `bytes`.
    ///
    /// # Errors
    /// [`io::ErrorKind::StorageFull`] when the rest of the disk is kept for the database.
    pub fn before(&mut self, bytes: usize) -> io::Result<()> {
        self.unlooked += bytes;
        if self.unlooked < LOOK_EVERY {
            return Ok(());
        }
        self.unlooked = 0;
        // A file system that does not tell its space says by itself when it is full.
        let is_full = DiskSpace::of(&self.folder).is_ok_and(|space| space.is_nearly_full());
        if is_full { Err(io::ErrorKind::StorageFull.into()) } else { Ok(()) }
    }
}

impl FileIdentity {
    pub fn of(path: &Path) -> io::Result<Self> {
        let metadata: Metadata = std::fs::metadata(path)?;
        Ok(Self { device: metadata.dev(), inode: metadata.ino() })
    }
}

impl Store {
    /// Writes to the database, and checks that its file is still the one that was opened.
    ///
    /// # Errors
    /// [`StoreError::DatabaseGone`] when the file was deleted or replaced.
    /// [`StoreError::DatabaseBusy`] when the database accepts no write within two seconds. The
    /// database's own error when it is read-only or damaged.
    #[boxed]
    pub async fn check_database(&self) -> Result<(), StoreError> {
        self.check_database_file()?;
        let write = async {
            let mut tx = self.begin(Scope::Rows, "trying to write").await?;
            sql!(&mut tx, probe())?;
            tx.commit().await
        };
        let written = tokio::time::timeout(WRITE_WITHIN, write).await;
        written.unwrap_or(Err(StoreError::DatabaseBusy { waited: WRITE_WITHIN }))
    }

    /// # Errors
    /// When the operating system reports an error.
    pub fn disk_space(&self) -> Result<DiskSpace, StoreError> {
        let dir = self.dir();
        DiskSpace::of(dir.path()).map_err(|reason| dir.unusable(reason))
    }

    /// Why no worker should claim a task at the moment, in one line.
    pub fn obstacle(&self) -> Option<String> {
        if let Err(error) = self.check_database_file() {
            return Some(error.to_string());
        }
        if let Some(obstacle) = self.objects().away().and_then(RemoteStore::obstacle) {
            return Some(obstacle);
        }
        if let Some(displaced) = self.objects().displaced() {
            return Some(displaced.obstacle().to_owned());
        }
        let space = self.disk_space().ok().filter(DiskSpace::is_low)?;
        Some(format!(
            "the disk of the data folder has {} MB free, but tasks are only claimed with {} MB or \
             more",
            space.free_bytes / 1_000_000,
            space.reserved_bytes / 1_000_000
        ))
    }

    fn check_database_file(&self) -> Result<(), StoreError> {
        let Some(opened) = self.database_file() else { return Ok(()) };
        match FileIdentity::of(&self.dir().database()) {
            Ok(found) if found == opened => Ok(()),
            Ok(_) | Err(_) => Err(StoreError::DatabaseGone),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Access;

    #[test]
    fn a_disk_keeps_a_twentieth_free_at_most() {
        let folder = tempfile::tempdir().unwrap();
        let space = DiskSpace::of(folder.path()).unwrap();
        assert!(space.reserved_bytes <= RESERVED_BYTES && space.free_bytes > 0);
        let low = DiskSpace { free_bytes: space.reserved_bytes.saturating_sub(1), ..space };
        assert!(low.is_low() && !DiskSpace { free_bytes: space.reserved_bytes, ..space }.is_low());
    }

    #[tokio::test]
    async fn a_database_that_was_deleted_or_replaced_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Access::Server).await.unwrap();
        store.check_database().await.unwrap();
        assert_eq!(store.obstacle(), None);

        let file = folder.path().join("torqued.sqlite");
        let bytes = std::fs::read(&file).unwrap();
        std::fs::remove_file(&file).unwrap();
        let gone = |error: &StoreError| matches!(error, StoreError::DatabaseGone);
        assert!(gone(&store.check_database().await.unwrap_err()));
        std::fs::write(&file, bytes).unwrap();
        assert!(gone(&store.check_database().await.unwrap_err()));
        assert!(store.obstacle().unwrap().contains("deleted or replaced"));
    }

    #[tokio::test]
    async fn a_database_that_another_process_holds_is_busy() {
        use sqlx::{ConnectOptions, Executor};
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Access::Server).await.unwrap();
        let file = folder.path().join("torqued.sqlite");
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(file);
        let mut other = options.connect().await.unwrap();
        other.execute("BEGIN IMMEDIATE").await.unwrap();
        let error = store.check_database().await.unwrap_err();
        assert!(matches!(error, StoreError::DatabaseBusy { .. }), "{error}");
        other.execute("ROLLBACK").await.unwrap();
        store.check_database().await.unwrap();
    }
}
