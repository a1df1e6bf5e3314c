//! Writes the bytes of an object: into the store, as a file of any folder, or nowhere.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use object_store::{MultipartUpload, WriteMultipart};
use sha2::{Digest as _, Sha256};
use spec::Digest;
use tokio::runtime::Handle;

use crate::{StoreError, StoredObject};

/// Bytes that are written at once; S3 wants at least 5 MiB.
const PART_SIZE: usize = 8 * 1024 * 1024;

/// Parts on their way to the disk at a time, which bounds memory.
const PARTS_IN_FLIGHT: usize = 2;

/// What an unfinished file of a folder is called: hidden, and not taken for a table.
const UNFINISHED: &str = ".unfinished";

/// Writes an object piece by piece; dropped before [`ObjectWriter::finish`], it leaves nothing.
///
/// Blocks, so use it where blocking is allowed: under `spawn_blocking` or on a thread of its own.
#[derive(Debug)]
pub struct ObjectWriter {
    target: Target,
    path: String,
    size: u64,
    digest: Sha256,
}

#[derive(Debug)]
enum Target {
    Upload { upload: WriteMultipart, runtime: Handle },
    Folder(UnfinishedFile),
    Nowhere,
}

impl ObjectWriter {
    /// Into the store. Needs the runtime it is called on to go on.
    pub(crate) fn upload(upload: Box<dyn MultipartUpload>, path: &str) -> Self {
        let upload = WriteMultipart::new_with_chunk_size(upload, PART_SIZE);
        Self::new(Target::Upload { upload, runtime: Handle::current() }, path)
    }

    /// Into a file of a folder, which appears under `name` whole and synced to disk, or not at all.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub fn in_folder(folder: &Path, name: &str) -> Result<Self, StoreError> {
        let file = UnfinishedFile::create(folder, name).map_err(failed(name))?;
        Ok(Self::new(Target::Folder(file), name))
    }

    /// Keeps nothing but size and digest.
    pub fn digest_only(name: &str) -> Self {
        Self::new(Target::Nowhere, name)
    }

    fn new(target: Target, path: &str) -> Self {
        Self { target, path: path.to_owned(), size: 0, digest: Sha256::new() }
    }

    pub fn path(&self) -> &str {
        &self.path
    }

    /// Syncs and publishes what was written.
    ///
    /// # Errors
    /// When the disk is full or fails; nothing lies under the path then.
    pub fn finish(self) -> Result<StoredObject, StoreError> {
        match self.target {
            Target::Upload { upload, runtime } => {
                runtime
                    .block_on(upload.finish())
                    .map_err(StoreError::object("writing", &self.path))?;
            }
            Target::Folder(file) => file.publish().map_err(failed(&self.path))?,
            Target::Nowhere => {}
        }
        let sha256 = Digest::from_bytes(self.digest.finalize().into());
        Ok(StoredObject { path: self.path, size: self.size, sha256 })
    }
}

impl io::Write for ObjectWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.target {
            Target::Upload { upload, runtime } => {
                runtime
                    .block_on(upload.wait_for_capacity(PARTS_IN_FLIGHT))
                    .map_err(io::Error::other)?;
                let _runtime = runtime.enter();
                upload.write(bytes);
            }
            Target::Folder(file) => file.write_all(bytes)?,
            Target::Nowhere => {}
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

fn failed(name: &str) -> impl FnOnce(io::Error) -> StoreError {
    StoreError::file("writing", name)
}

/// A file beside the one it is to become; deleted when it does not.
#[derive(Debug)]
struct UnfinishedFile {
    file: File,
    at: PathBuf,
    to: PathBuf,
    folder: PathBuf,
    unsynced: usize,
    published: bool,
}

impl UnfinishedFile {
    fn create(folder: &Path, name: &str) -> io::Result<Self> {
        let at = folder.join(format!(".{name}{UNFINISHED}"));
        Ok(Self {
            file: File::create(&at)?,
            at,
            to: folder.join(name),
            folder: folder.to_owned(),
            unsynced: 0,
            published: false,
        })
    }

    /// Syncs as it goes, so that the disk works all the time instead of at the end.
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        io::Write::write_all(&mut self.file, bytes)?;
        self.unsynced += bytes.len();
        if self.unsynced >= PART_SIZE {
            self.file.sync_data()?;
            self.unsynced = 0;
        }
        Ok(())
    }

    fn publish(mut self) -> io::Result<()> {
        self.file.sync_all()?;
        std::fs::rename(&self.at, &self.to)?;
        self.published = true;
        // The name is durable when the folder is.
        File::open(&self.folder)?.sync_all()
    }
}

impl Drop for UnfinishedFile {
    fn drop(&mut self) {
        if !self.published {
            // Whoever cannot delete it now finds it hidden, and overwrites it next time.
            let _ = std::fs::remove_file(&self.at);
        }
    }
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
