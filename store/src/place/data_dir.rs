//! The data folder: its layout, and the lock of its server.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

use crate::StoreError;

/// The purpose for which a process opens the store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Creates the folder, migrates the schema and holds the folder's lock. Only one process at a
    /// time has this access.
    Server,
    /// Uses a store that a server made. Any number of processes may.
    Worker,
    /// Fills a new store with the contents of another one. Like a server, but it also continues an
    /// unfinished transfer.
    Transfer,
    /// Rebuilds a lost database from its objects. Like a server, but it also takes over objects of
    /// another store.
    Rebuilding,
}

impl Access {
    /// Whether the process creates missing parts and holds the lock.
    pub(crate) fn is_owner(self) -> bool {
        self != Self::Worker
    }
}

/// Paths inside a data folder.
#[derive(Clone, Debug)]
pub(crate) struct DataDir(PathBuf);

impl DataDir {
    pub fn new(dir: &Path) -> Self {
        Self(dir.to_owned())
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    pub fn database(&self) -> PathBuf {
        self.0.join("torqued.sqlite")
    }

    /// The file that wakes workers. Processes that queue tasks open and close it, and workers watch
    /// it.
    pub fn bell(&self) -> PathBuf {
        self.0.join("queue.bell")
    }

    /// The folder's name in errors.
    pub fn place(&self) -> String {
        format!("data folder {}", self.0.display())
    }

    pub fn objects(&self) -> PathBuf {
        self.0.join("objects")
    }

    /// The folder with copies of remote objects.
    pub fn cache(&self) -> PathBuf {
        self.0.join("cache")
    }

    fn lock_file(&self) -> PathBuf {
        self.0.join("server.lock")
    }

    /// Whether torqued gives this name to a file of the data folder itself.
    pub fn has_made(&self, name: &str) -> bool {
        let path = self.0.join(name);
        let database = self.database();
        let is_database = ["", "-wal", "-shm", "-journal"].into_iter().any(|ending| {
            let mut file = database.clone().into_os_string();
            file.push(ending);
            path.as_os_str() == file
        });
        is_database || path == self.lock_file() || path == self.bell()
    }

    /// Whether the folder lies on a file system that is mounted read-only.
    pub fn is_read_only(&self) -> bool {
        nix::unistd::access(&self.0, nix::unistd::AccessFlags::W_OK) == Err(nix::Error::EROFS)
    }

    /// Creates the folder. Only the owner may read a new data folder. An existing folder keeps its
    /// mode.
    pub fn create(&self) -> Result<(), StoreError> {
        self.create_private().map_err(|reason| self.unusable(reason))
    }

    /// Creates the folder for objects.
    pub fn create_objects(&self) -> Result<(), StoreError> {
        std::fs::create_dir_all(self.objects()).map_err(|reason| self.unusable(reason))
    }

    fn create_private(&self) -> std::io::Result<()> {
        let create = || match std::fs::DirBuilder::new().mode(0o700).create(&self.0) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(()),
            created => created,
        };
        match (create(), self.0.parent()) {
            (Err(error), Some(parent)) if error.kind() == ErrorKind::NotFound => {
                std::fs::create_dir_all(parent)?;
                create()
            }
            (created, _) => created,
        }
    }

    /// Takes the server's lock. The returned handle holds it until it is dropped or its process
    /// dies.
    pub fn lock(&self) -> Result<File, StoreError> {
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(self.lock_file())
            .map_err(|reason| self.unusable(reason))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut text = String::new();
                let pid =
                    file.read_to_string(&mut text).ok().and_then(|_| text.trim().parse().ok());
                return Err(StoreError::InUse { dir: self.0.clone(), pid });
            }
            Err(TryLockError::Error(reason)) => return Err(self.unusable(reason)),
        }
        write_pid(&mut file).map_err(|reason| self.unusable(reason))?;
        Ok(file)
    }

    pub fn unusable(&self, reason: std::io::Error) -> StoreError {
        if crate::error::is_disk_full(&reason) {
            return StoreError::DiskFull {
                operation: format!("opening data folder {}", self.0.display()),
            };
        }
        StoreError::Unusable { dir: self.0.clone(), reason }
    }
}

fn write_pid(file: &mut File) -> std::io::Result<()> {
    file.set_len(0)?;
    file.rewind()?;
    writeln!(file, "{}", std::process::id())
}
