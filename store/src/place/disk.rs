//! The disk of the data folder: how much room it has, and which file is which.

use std::fs::Metadata;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use nix::sys::statvfs::statvfs;

/// Space on the disk of the data folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DiskSpace {
    /// Bytes that the user of this process may still write.
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

    /// Whether tasks wait until there is more room.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_keeps_a_twentieth_free_at_most() {
        let folder = tempfile::tempdir().unwrap();
        let space = DiskSpace::of(folder.path()).unwrap();
        assert!(space.reserved_bytes <= RESERVED_BYTES && space.free_bytes > 0);
        let low = DiskSpace { free_bytes: space.reserved_bytes.saturating_sub(1), ..space };
        assert!(low.is_low() && !DiskSpace { free_bytes: space.reserved_bytes, ..space }.is_low());
    }
}
