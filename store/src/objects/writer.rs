//! Writes the bytes of an object: into the store, to a file in any folder, or nowhere.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};
use spec::Digest;

use super::cache::UnfinishedCopy;
use super::unfinished_file::UnfinishedFile;
use crate::place::disk::LastRoom;
use crate::{Store, StoreError, StoredObject};

/// The suffix of an object's file until it is whole. `object_store` uses a hash and a number for
/// its own unfinished files and does not list them. The sweep finds both.
const UNFINISHED_OBJECT: &str = "#0";

/// Writes an object in pieces. If it is dropped before [`ObjectWriter::finish`], it leaves nothing.
///
/// It blocks, so use it under `spawn_blocking` or on a thread of its own.
#[derive(Debug)]
pub struct ObjectWriter {
    to: Destination,
    path: String,
    size: u64,
    digest: Sha256,
    /// For an object of a store.
    room: Option<LastRoom>,
}

#[derive(Debug)]
enum Destination {
    File(UnfinishedFile),
    /// A file whose bytes will be published to a remote store.
    Remote(Store, UnfinishedCopy),
    /// Only computes the digest.
    Nowhere,
}

impl ObjectWriter {
    /// Writes into the store. For a remote store, publishing begins when all bytes are there: the
    /// upload is then short and can be retried, however long it took to make the bytes.
    pub(crate) fn in_store(store: &Store, path: &str) -> Result<Self, StoreError> {
        store.objects().check_place_blocking()?;
        let writer = match store.objects().away() {
            Some(elsewhere) => {
                Self::new(Destination::Remote(store.clone(), elsewhere.begin(path)?), path)
            }
            None => Self::below(store.objects().folder().unwrap_or(Path::new(".")), path)?,
        };
        Ok(Self { room: Some(LastRoom::of(store.dir().path())), ..writer })
    }

    /// Writes into a file below `root`.
    pub(crate) fn below(root: &Path, path: &str) -> Result<Self, StoreError> {
        let to = root.join(path);
        let at = PathBuf::from(format!("{}{UNFINISHED_OBJECT}", to.display()));
        let created =
            to.parent().map_or(Ok(()), create_folder).and_then(|()| UnfinishedFile::create(at, to));
        Ok(Self::new(Destination::File(created.map_err(failed(path))?), path))
    }

    /// Writes a file in a folder. It appears under `name` whole and synced to disk, or not at all.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub fn in_folder(folder: &Path, name: &str) -> Result<Self, StoreError> {
        // The name is hidden, so nobody takes the file for a table.
        let at = folder.join(format!(".{name}.unfinished"));
        let file = UnfinishedFile::create(at, folder.join(name)).map_err(failed(name))?;
        Ok(Self::new(Destination::File(file), name))
    }

    /// Computes only size and digest.
    pub fn digest_only(name: &str) -> Self {
        Self::new(Destination::Nowhere, name)
    }

    fn new(to: Destination, path: &str) -> Self {
        Self { to, path: path.to_owned(), size: 0, digest: Sha256::new(), room: None }
    }

    /// The path of the object.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Syncs and publishes the bytes.
    ///
    /// # Errors
    /// When the disk is full or fails, or the object store refuses or does not answer. Nothing lies
    /// under the path then. [`StoreError::ObjectTaken`] when another object lies there.
    pub fn finish(self) -> Result<StoredObject, StoreError> {
        let sha256 = Digest::from_bytes(self.digest.finalize().into());
        let object = StoredObject { path: self.path, size: self.size, sha256 };
        match self.to {
            Destination::File(file) => file.publish().map_err(failed(&object.path))?,
            Destination::Remote(store, copy) => {
                if let Some(elsewhere) = store.objects().away() {
                    elsewhere.publish(copy, &object)?;
                }
            }
            Destination::Nowhere => {}
        }
        Ok(object)
    }
}

impl io::Write for ObjectWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Some(room) = &mut self.room {
            room.before(bytes.len())?;
        }
        match &mut self.to {
            Destination::File(file) => file.write_all(bytes)?,
            Destination::Remote(_, copy) => copy.file().write_all(bytes)?,
            Destination::Nowhere => {}
        }
        self.digest.update(bytes);
        self.size += bytes.len() as u64;
        Ok(bytes.len())
    }

    /// Nothing is durable before [`ObjectWriter::finish`].
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Creates a folder and its parents. Their names are durable when this returns.
pub(super) fn create_folder(folder: &Path) -> io::Result<()> {
    if folder.is_dir() {
        return Ok(());
    }
    let Some(parent) = folder.parent() else { return Ok(()) };
    create_folder(parent)?;
    match std::fs::create_dir(folder) {
        // Another worker was faster. Both make sure that the name is durable.
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        Ok(()) | Err(_) => {}
    }
    File::open(parent)?.sync_all()
}

fn failed(name: &str) -> impl FnOnce(io::Error) -> StoreError {
    StoreError::file("writing", name)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_of_a_folder_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = ObjectWriter::in_folder(folder.path(), "a").unwrap();
        writer.write_all(b"torqued").unwrap();
        assert_ne!(names(folder.path()), ["a"]);
        let object = writer.finish().unwrap();
        assert_eq!((object.size, object.sha256), (7, Digest::of(b"torqued")));
        assert_eq!(std::fs::read(folder.path().join("a")).unwrap(), b"torqued");

        let mut writer = ObjectWriter::in_folder(folder.path(), "b").unwrap();
        writer.write_all(b"torqued").unwrap();
        drop(writer);
        assert_eq!(names(folder.path()), ["a"]);
    }

    #[test]
    fn a_digest_is_the_same_wherever_the_bytes_go() {
        let folder = tempfile::tempdir().unwrap();
        let mut kept = ObjectWriter::in_folder(folder.path(), "a").unwrap();
        let mut lost = ObjectWriter::digest_only("a");
        for writer in [&mut kept, &mut lost] {
            writer.write_all(&[7; 100_000]).unwrap();
        }
        assert_eq!(kept.finish().unwrap(), lost.finish().unwrap());
    }
}
