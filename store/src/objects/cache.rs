//! Copies of remote objects in a folder of this machine. Each copy lies under the digest of its
//! bytes.
//!
//! A copy gets its name when it is whole, compared with the digest and synced. So opening it does
//! not read its bytes again. Processes share the folder: a process that wants an object waits if
//! another one is fetching it. If there is no room for the next copy, the least recently opened
//! copies are deleted; a process that has one open can still read it.

use std::fs::{DirEntry, File};
use std::io::{self, Seek};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use spec::Digest;

use super::path::{is_unique_name, unique_name};
use super::unfinished_file::{self, UnfinishedLeftover};
use crate::place::disk::DiskSpace;

/// Limit of the size of all copies together. Half of the available disk is the limit if that is
/// less.
pub(crate) const CACHE_LIMIT: u64 = 20 << 30;

/// Smaller objects are not cached: there are many, and fetching one takes no longer than looking it
/// up.
pub(crate) const KEPT_FROM: u64 = 64 << 10;

/// The name of a copy's file until it is whole. The process that writes it holds a lock on it.
const UNFINISHED: &str = "part";

/// The beginning of the name of a copy whose digest is not known yet.
const NEW: &str = "new";

/// An unlocked copy without a write for this long was left by a process that died.
const LEFT_BEHIND: Duration = Duration::from_secs(3600);

#[derive(Clone, Debug)]
pub(crate) struct Cache {
    folder: PathBuf,
    limit: u64,
}

/// An object in the cache, or the right to put it there.
#[derive(Debug)]
pub(crate) enum CacheSlot {
    Taken(File),
    Free(UnfinishedCopy),
}

/// A file on its way into the cache. It is deleted if it is dropped before it is kept.
#[derive(Debug)]
pub(crate) struct UnfinishedCopy {
    file: File,
    at: PathBuf,
    kept: bool,
}

impl Cache {
    pub fn new(folder: PathBuf, limit: u64) -> io::Result<Self> {
        std::fs::create_dir_all(&folder)?;
        Ok(Self { folder, limit })
    }

    /// Finds the copy with this digest. Waits while another process or thread fetches it.
    pub fn place(&self, digest: Digest, size: u64) -> io::Result<CacheSlot> {
        let at = self.folder.join(format!("{digest}.{UNFINISHED}"));
        loop {
            if let Some(file) = self.open(digest, size)? {
                return Ok(CacheSlot::Taken(file));
            }
            let file =
                File::options().read(true).write(true).create(true).truncate(false).open(&at)?;
            file.lock()?;
            // The process that held the lock may have kept the copy, or given it up.
            if !has_name(&file, &at)? {
                continue;
            }
            let copy = UnfinishedCopy { file, at, kept: false };
            if let Some(file) = self.open(digest, size)? {
                return Ok(CacheSlot::Taken(file));
            }
            copy.file.set_len(0)?;
            return Ok(CacheSlot::Free(copy));
        }
    }

    /// Begins a copy whose digest is not known yet.
    pub fn begin(&self) -> io::Result<UnfinishedCopy> {
        let at = self.folder.join(format!("{}.{UNFINISHED}", unique_name(NEW)));
        let file = File::options().read(true).write(true).create_new(true).open(&at)?;
        file.lock()?;
        Ok(UnfinishedCopy { file, at, kept: false })
    }

    /// Deletes old copies to make room. Returns whether a copy of this size can be kept.
    pub fn make_room(&self, size: u64) -> io::Result<bool> {
        let mut copies = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            let entry = entry?;
            if is_copy(&entry) {
                // Another process may have deleted it meanwhile.
                let Ok(metadata) = entry.metadata() else { continue };
                copies.push((metadata.modified()?, metadata.len(), entry.path()));
            }
        }
        for left in self.leftovers(LEFT_BEHIND)? {
            unfinished_file::delete(&left.file);
        }
        let mut used: u64 = copies.iter().map(|(_, size, _)| size).sum();
        let free = DiskSpace::of(&self.folder)?.free_bytes;
        let limit = self.limit.min((free + used) / 2);
        if size < KEPT_FROM || size > limit {
            return Ok(false);
        }
        copies.sort_unstable();
        for (_, freed, path) in copies {
            if used + size <= limit {
                break;
            }
            std::fs::remove_file(path).or_else(unless_gone)?;
            used -= freed;
        }
        Ok(true)
    }

    /// Unfinished copies that are older than `age` and that no process works on any more.
    pub fn leftovers(&self, age: Duration) -> io::Result<Vec<UnfinishedLeftover>> {
        let mut found = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            let entry = entry?;
            // Another process may have deleted it meanwhile.
            let Ok(metadata) = entry.metadata() else { continue };
            let is_left = entry.file_name().to_str().is_some_and(is_unfinished)
                && metadata.is_file()
                && metadata.modified()?.elapsed().is_ok_and(|elapsed| elapsed > age)
                && !unfinished_file::is_in_use(&entry.path());
            if is_left {
                found.push(UnfinishedLeftover { file: entry.path(), size: metadata.len() });
            }
        }
        found.sort_by(|a, b| a.file.cmp(&b.file));
        Ok(found)
    }

    /// Gives its final name to a whole copy whose digest is right.
    pub fn keep(&self, mut copy: UnfinishedCopy, digest: Digest) -> io::Result<File> {
        copy.file.sync_all()?;
        std::fs::rename(&copy.at, self.path(digest))?;
        copy.kept = true;
        copy.file.unlock()?;
        copy.reader()
    }

    /// Opens a copy and marks it as used.
    fn open(&self, digest: Digest, size: u64) -> io::Result<Option<File>> {
        let file = match File::open(self.path(digest)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            opened => opened?,
        };
        if file.metadata()?.len() != size {
            std::fs::remove_file(self.path(digest)).or_else(unless_gone)?;
            return Ok(None);
        }
        // The time of another user's file cannot be set, so that copy is deleted earlier.
        let _ = file.set_modified(SystemTime::now());
        Ok(Some(file))
    }

    fn path(&self, digest: Digest) -> PathBuf {
        self.folder.join(digest.to_string())
    }
}

impl UnfinishedCopy {
    pub const fn file(&self) -> &File {
        &self.file
    }

    /// Opens the copy for reading from its first byte. If it was not kept, it is gone once this is
    /// closed.
    pub fn reader(&self) -> io::Result<File> {
        let mut file = self.file.try_clone()?;
        file.rewind()?;
        Ok(file)
    }
}

impl Drop for UnfinishedCopy {
    fn drop(&mut self) {
        if !self.kept {
            // A file that cannot be deleted now is deleted later as left behind.
            let _ = std::fs::remove_file(&self.at);
        }
    }
}

fn is_copy(entry: &DirEntry) -> bool {
    let name = entry.file_name();
    name.to_str().is_some_and(|name| name.parse::<Digest>().is_ok())
}

/// Whether the cache gives such a name to a file, to a whole copy or to an unfinished one. Files
/// with other names belong to somebody else and are never deleted.
pub(crate) fn is_made(name: &str) -> bool {
    name.parse::<Digest>().is_ok() || is_unfinished(name)
}

fn is_unfinished(name: &str) -> bool {
    let name = name.strip_suffix(UNFINISHED).and_then(|name| name.strip_suffix('.'));
    name.is_some_and(|name| name.parse::<Digest>().is_ok() || is_unique_name(NEW, name))
}

/// Whether the open file still has the name `path`.
fn has_name(file: &File, path: &Path) -> io::Result<bool> {
    let open = file.metadata()?;
    match std::fs::metadata(path) {
        Ok(named) => Ok((named.dev(), named.ino()) == (open.dev(), open.ino())),
        Err(error) => unless_gone(error).map(|()| false),
    }
}

fn unless_gone(error: io::Error) -> io::Result<()> {
    if error.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(error) }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::sync::mpsc::channel;
    use std::thread;

    use super::*;

    const LARGE: usize = 100_000;

    fn cache(limit: u64) -> (Cache, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        (Cache::new(folder.path().join("cache"), limit).unwrap(), folder)
    }

    fn bytes(value: u8) -> (Vec<u8>, Digest) {
        let bytes = vec![value; LARGE];
        let digest = Digest::of(&bytes);
        (bytes, digest)
    }

    fn keep(cache: &Cache, value: u8) -> bool {
        let (bytes, digest) = bytes(value);
        let copy = cache.begin().unwrap();
        copy.file().write_all(&bytes).unwrap();
        let has_room = cache.make_room(LARGE as u64).unwrap();
        if has_room {
            cache.keep(copy, digest).unwrap();
        }
        has_room
    }

    fn has(cache: &Cache, value: u8) -> bool {
        cache.open(bytes(value).1, LARGE as u64).unwrap().is_some()
    }

    fn names(cache: &Cache) -> usize {
        std::fs::read_dir(&cache.folder).unwrap().count()
    }

    #[test]
    fn the_copy_that_was_not_opened_for_longest_goes_first() {
        let (cache, _folder) = cache(3 * LARGE as u64);
        for value in 0..3 {
            assert!(keep(&cache, value));
            thread::sleep(Duration::from_millis(2));
        }
        let mut open = cache.open(bytes(1).1, LARGE as u64).unwrap().unwrap();
        thread::sleep(Duration::from_millis(2));
        assert!(has(&cache, 0));
        thread::sleep(Duration::from_millis(2));
        assert!(keep(&cache, 3));
        assert_eq!([0, 1, 2, 3].map(|value| has(&cache, value)), [true, true, false, true]);
        for value in 4..8 {
            assert!(keep(&cache, value));
        }
        assert!(!has(&cache, 1));
        let mut read = Vec::new();
        open.read_to_end(&mut read).unwrap();
        assert_eq!(read, bytes(1).0, "who has it open keeps its bytes");
        assert_eq!(names(&cache), 3);
    }

    #[test]
    fn what_is_too_large_or_too_small_is_not_kept_and_nothing_goes_for_it() {
        let (cache, _folder) = cache(2 * LARGE as u64);
        assert!(keep(&cache, 0));
        assert!(!cache.make_room(2 * LARGE as u64 + 1).unwrap());
        assert!(!cache.make_room(KEPT_FROM - 1).unwrap());
        assert!(has(&cache, 0));
    }

    #[test]
    fn who_wants_what_another_one_fetches_waits_for_it() {
        let (cache, _folder) = cache(u64::MAX);
        let (bytes, digest) = bytes(7);
        let CacheSlot::Free(copy) = cache.place(digest, LARGE as u64).unwrap() else { panic!() };
        let (send, receive) = channel();
        thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| send.send(cache.place(digest, LARGE as u64).unwrap()).unwrap());
            }
            thread::sleep(Duration::from_millis(20));
            assert!(receive.try_recv().is_err(), "it is not whole yet");
            copy.file().write_all(&bytes).unwrap();
            cache.keep(copy, digest).unwrap();
        });
        for _ in 0..3 {
            assert!(matches!(receive.recv().unwrap(), CacheSlot::Taken(_)));
        }
        assert_eq!(names(&cache), 1);
    }

    #[test]
    fn whoever_waits_fetches_it_when_the_other_one_gives_up() {
        let (cache, _folder) = cache(u64::MAX);
        let (bytes, digest) = bytes(7);
        let CacheSlot::Free(copy) = cache.place(digest, LARGE as u64).unwrap() else { panic!() };
        copy.file().write_all(&bytes[..10]).unwrap();
        thread::scope(|scope| {
            let waits = scope.spawn(|| cache.place(digest, LARGE as u64).unwrap());
            thread::sleep(Duration::from_millis(20));
            drop(copy);
            let CacheSlot::Free(copy) = waits.join().unwrap() else { panic!() };
            assert_eq!(copy.file().metadata().unwrap().len(), 0);
        });
        assert_eq!(names(&cache), 0);
    }

    #[test]
    fn a_copy_of_another_size_is_no_copy() {
        let (cache, _folder) = cache(u64::MAX);
        assert!(keep(&cache, 1));
        File::options().write(true).open(cache.path(bytes(1).1)).unwrap().set_len(10).unwrap();
        assert!(!has(&cache, 1) && names(&cache) == 0);
    }

    #[test]
    fn what_a_process_left_that_died_is_deleted_later() {
        let (cache, _folder) = cache(u64::MAX);
        let left = cache.folder.join(format!("{}.part", unique_name(NEW)));
        let others = cache.folder.join("thesis.part");
        for file in [&left, &others] {
            std::fs::write(file, "half").unwrap();
        }
        let alive = cache.begin().unwrap();
        let long_ago = SystemTime::now() - 2 * LEFT_BEHIND;
        cache.make_room(0).unwrap();
        assert_eq!(names(&cache), 3, "too young");
        for file in [&left, &others] {
            File::options().write(true).open(file).unwrap().set_modified(long_ago).unwrap();
        }
        alive.file().set_modified(long_ago).unwrap();
        cache.make_room(0).unwrap();
        assert!(!left.exists() && alive.at.exists());
        assert!(others.exists(), "torqued did not make it");
    }
}
