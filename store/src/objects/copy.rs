//! Copying an object to a second path.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::SystemTime;

use object_store::ObjectStoreExt;

use super::writer::create_folder;
use super::{ObjectWriter, Objects, parse};
use crate::boxed;
use crate::{Store, StoreError, StoredObject};

/// The largest object that S3 copies in one request.
const COPIED_AT_ONCE: u64 = 5 << 30;

impl Store {
    /// Publishes the bytes of `object` under `path` too. Local files are checked against their
    /// digest, and both paths name one file if the file system supports that.
    ///
    /// # Errors
    /// When the object does not exist or its bytes differ from those that were published. When the
    /// disk is full or fails.
    #[boxed]
    pub async fn copy_object(
        &self,
        object: &StoredObject,
        path: &str,
    ) -> Result<StoredObject, StoreError> {
        self.objects().check_place().await?;
        let to = parse(path)?;
        let is_away = self.objects().away().is_some();
        if is_away && object.size <= COPIED_AT_ONCE {
            self.look_up_object(object).await?;
            let copied = self.objects().remote().copy(&parse(&object.path)?, &to).await;
            copied.map_err(StoreError::object("copying", &object.path))?;
            return Ok(StoredObject { path: path.to_owned(), ..object.clone() });
        }
        let (store, object, path) = (self.clone(), object.clone(), path.to_owned());
        let failed = StoreError::file("copying", &path);
        let copy = move || match store.objects().away() {
            Some(_) => copy_through_file(&store, &object, &path),
            None => copy_file(store.objects(), &object, &path),
        };
        let copied = tokio::task::spawn_blocking(copy).await;
        copied.map_err(|error| failed(io::Error::other(error)))?
    }
}

fn copy_through_file(
    store: &Store,
    object: &StoredObject,
    path: &str,
) -> Result<StoredObject, StoreError> {
    let mut file = store.objects().open_verified(object)?;
    let mut writer = ObjectWriter::in_store(store, path)?;
    io::copy(&mut file, &mut writer).map_err(StoreError::file("copying", &object.path))?;
    writer.finish()
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
    // The sweep takes an old file without a row for an orphan, and this one has no row yet.
    file.set_modified(SystemTime::now()).map_err(failed())?;
    if link(&from, &to).is_ok() {
        return Ok(StoredObject { path: path.to_owned(), ..object.clone() });
    }
    let mut writer = ObjectWriter::below(folder, path)?;
    io::copy(&mut file, &mut writer).map_err(failed())?;
    writer.finish()
}

/// Gives a file a second name, which is durable when this returns.
fn link(from: &Path, to: &Path) -> io::Result<()> {
    let folder = to.parent().unwrap_or(Path::new("."));
    create_folder(folder)?;
    std::fs::hard_link(from, to)?;
    File::open(folder)?.sync_all()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use object_store::ObjectStore;

    use super::*;
    use crate::{Access, Location};

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn what_a_store_does_not_copy_by_itself_goes_through_a_file() {
        let objects: Arc<dyn ObjectStore> = Arc::new(object_store::memory::InMemory::new());
        let folder = tempfile::tempdir().unwrap();
        let location = Location::in_folder(folder.path());
        let opened = Store::open_with_objects(&location, Access::Server, objects.into()).await;
        let store = opened.unwrap();
        let object = store.put_object("a", vec![7; 100_000].into()).await.unwrap();
        let copied = tokio::task::block_in_place(|| copy_through_file(&store, &object, "b"));
        let copied = copied.unwrap();
        assert_eq!(copied, StoredObject { path: "b".to_owned(), ..object });
        assert_eq!(store.read_object(&copied).await.unwrap(), vec![7; 100_000]);
    }
}
