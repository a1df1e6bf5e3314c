use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::path;

/// Number of bytes after which the disk is asked to write them.
const SYNC_EVERY: usize = 8 * 1024 * 1024;

/// A file that is being written under a temporary name. It appears under its final name whole and
/// synced to disk, or not at all.
#[derive(Debug)]
pub(crate) struct UnfinishedFile {
    file: Arc<File>,
    at: PathBuf,
    to: PathBuf,
    unsynced: usize,
    sync: Option<Syncing>,
    published: bool,
}

impl UnfinishedFile {
    /// Creates the file that will be named `to`, under the name `at` in the same folder.
    pub fn create(at: PathBuf, to: PathBuf) -> io::Result<Self> {
        let file = Arc::new(File::create(&at)?);
        // The lock says that the file is in use, however long nothing is written. A file system
        // without locks leaves it to the file's age.
        let _ = file.try_lock();
        Ok(Self { file, at, to, unsynced: 0, sync: None, published: false })
    }

    pub fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        io::Write::write_all(&mut &*self.file, bytes)?;
        self.unsynced += bytes.len();
        if self.unsynced >= SYNC_EVERY {
            self.unsynced = 0;
            let file = &self.file;
            self.sync.get_or_insert_with(|| Syncing::of(file)).ask();
        }
        Ok(())
    }

    /// Syncs the file and gives it its final name.
    pub fn publish(mut self) -> io::Result<()> {
        if let Some(sync) = self.sync.take() {
            sync.end()?;
        }
        self.file.sync_all()?;
        std::fs::rename(&self.at, &self.to)?;
        self.published = true;
        // The name is durable after the folder is synced.
        File::open(self.to.parent().unwrap_or(Path::new(".")))?.sync_all()
    }
}

impl Drop for UnfinishedFile {
    fn drop(&mut self) {
        if self.published {
            return;
        }
        if let Some(sync) = self.sync.take() {
            let _ = sync.end();
        }
        // A file that cannot be deleted now is not an object, and is swept or overwritten later.
        let _ = std::fs::remove_file(&self.at);
    }
}

/// An unfinished file that no process writes any more.
#[derive(Clone, Debug)]
pub(crate) struct UnfinishedLeftover {
    pub file: PathBuf,
    pub size: u64,
}

/// Finds unfinished files of objects in a folder that are older than `age` and not in use. That
/// includes files of `object_store`, which writes to `NAME#N` beside the destination and does not
/// list those files. Files whose names torqued does not make are left out.
pub(crate) fn find_below(root: &Path, age: Duration) -> io::Result<Vec<UnfinishedLeftover>> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        let Some(entries) = unless_gone(std::fs::read_dir(folder))? else { continue };
        for entry in entries {
            let Some(entry) = unless_gone(entry)? else { continue };
            let Some(metadata) = unless_gone(entry.metadata())? else { continue };
            let file = entry.path();
            if metadata.is_dir() {
                folders.push(file);
            } else if file.strip_prefix(root).is_ok_and(is_unfinished)
                && metadata.modified()?.elapsed().is_ok_and(|elapsed| elapsed > age)
                && !is_in_use(&file)
            {
                found.push(UnfinishedLeftover { file, size: metadata.len() });
            }
        }
    }
    found.sort_by(|a, b| a.file.cmp(&b.file));
    Ok(found)
}

fn is_unfinished(path: &Path) -> bool {
    path.to_str().is_some_and(path::is_unfinished)
}

/// Whether a process holds a lock on the file.
pub(super) fn is_in_use(file: &Path) -> bool {
    File::open(file).is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
}

/// Deletes an unfinished file unless it is in use. Returns the number of deleted files. An error is
/// logged, because there is a next time.
pub(super) fn delete(file: &Path) -> u64 {
    if is_in_use(file) {
        return 0;
    }
    match unless_gone(std::fs::remove_file(file)) {
        Ok(deleted) => u64::from(deleted.is_some()),
        Err(error) => {
            tracing::warn!(file = %file.display(), %error, "cannot delete an unfinished file");
            0
        }
    }
}

/// `None` if the file is gone: workers publish and prune during a sweep.
fn unless_gone<T>(found: io::Result<T>) -> io::Result<Option<T>> {
    match found {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        found => found.map(Some),
    }
}

/// Keeps the disk busy during the whole write, instead of only at the end. Its thread syncs the
/// file repeatedly while there is more, and nobody waits for it.
#[derive(Debug)]
struct Syncing {
    ask: SyncSender<()>,
    thread: JoinHandle<io::Result<()>>,
}

impl Syncing {
    fn of(file: &Arc<File>) -> Self {
        let file = Arc::clone(file);
        let (ask, asked) = sync_channel(1);
        // The disk may report an error only to this thread.
        let thread = thread::spawn(move || asked.iter().try_for_each(|()| file.sync_data()));
        Self { ask, thread }
    }

    fn ask(&self) {
        // A sync that is waiting covers this request too.
        let _ = self.ask.try_send(());
    }

    fn end(self) -> io::Result<()> {
        drop(self.ask);
        self.thread.join().map_err(|_| io::Error::other("the thread that syncs has panicked"))?
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    /// Workers publish, prune and delete while a server sweeps.
    #[test]
    fn files_and_folders_that_vanish_do_not_end_a_sweep() {
        let root = tempfile::tempdir().unwrap();
        let is_over = AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    let folder = root.path().join("step");
                    std::fs::create_dir(&folder).unwrap();
                    (0..50).for_each(|k| std::fs::write(folder.join(k.to_string()), "").unwrap());
                    std::fs::remove_dir_all(folder).unwrap();
                }
            });
            for _ in 0..300 {
                assert!(find_below(root.path(), Duration::from_secs(3600)).unwrap().is_empty());
            }
            is_over.store(true, Ordering::Relaxed);
        });
    }

    #[test]
    fn only_unfinished_objects_that_nobody_writes_are_found() {
        let root = tempfile::tempdir().unwrap();
        let object = root.path().join("datasets/1/shard-00000-e1-robots.parquet");
        std::fs::create_dir_all(object.parent().unwrap()).unwrap();
        let at = |name: &str| PathBuf::from(format!("{}{name}", object.display()));
        std::fs::write(at("#0"), "half").unwrap();
        for other in ["ball.obj#1", "#notes#", "datasets/1/robots.parquet#0"] {
            std::fs::write(root.path().join(other), "mine").unwrap();
        }
        let alive = UnfinishedFile::create(at("#7"), object.clone()).unwrap();
        let found = || find_below(root.path(), Duration::ZERO).unwrap();
        std::thread::sleep(Duration::from_millis(5));
        assert!(find_below(root.path(), Duration::from_secs(3600)).unwrap().is_empty());
        let files: Vec<_> = found().into_iter().map(|left| (left.file, left.size)).collect();
        assert_eq!(files, [(at("#0"), 4)]);
        assert_eq!(delete(&alive.at), 0, "it is in use");
        assert_eq!(delete(&at("#0")), 1);
        assert_eq!(found().len(), 0);
    }
}
