//! One object's bytes under a second path.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::SystemTime;

use object_store::ObjectStoreExt;

use super::writer::create_folder;
use super::{ObjectWriter, Objects, parse};
use crate::{Store, StoreError, StoredObject};

impl Store {
    /// Publishes the bytes of `object` under `path`, too. Where objects are files, they are checked against their
    /// digest, and both paths name one file as far as the file system allows that.
    ///
    /// # Errors
    /// When the object is not there, or has not the bytes that were published; when the disk is full or fails.
    pub async fn copy_object(
        &self,
        object: &StoredObject,
        path: &str,
    ) -> Result<StoredObject, StoreError> {
        let to = parse(path)?;
        if self.objects().folder().is_none() {
            let copied = self.objects().remote().copy(&parse(&object.path)?, &to).await;
            copied.map_err(StoreError::object("copying", &object.path))?;
            return Ok(StoredObject { path: path.to_owned(), ..object.clone() });
        }
        let (store, object, path) = (self.clone(), object.clone(), path.to_owned());
        let failed = StoreError::file("copying", &path);
        tokio::task::spawn_blocking(move || copy_file(store.objects(), &object, &path))
            .await
            .map_err(|error| failed(io::Error::other(error)))?
    }
}

fn copy_file(
    objects: &Objects,
    object: &StoredObject,
    path: &str,
) -> Result<StoredObject, StoreError> {
    let failed = || StoreError::file("copying", &object.path);
    let mut file = objects.open_verified(object)?;
    let folder = objects.folder().unwrap_or(Path::new("."));
    let (from, to) = (folder.join(&object.path), folder.join(path));
    // The sweep takes an old file without a row for an orphan, and the row of this one is yet to come.
    file.set_modified(SystemTime::now()).map_err(failed())?;
    if link(&from, &to).is_ok() {
        return Ok(StoredObject { path: path.to_owned(), ..object.clone() });
    }
    let mut writer = ObjectWriter::in_store(folder, path)?;
    io::copy(&mut file, &mut writer).map_err(failed())?;
    writer.finish()
}

/// A second name for a file, durable when this returns.
fn link(from: &Path, to: &Path) -> io::Result<()> {
    let folder = to.parent().unwrap_or(Path::new("."));
    create_folder(folder)?;
    std::fs::hard_link(from, to)?;
    File::open(folder)?.sync_all()
}
