//! How objects are written and read.

use std::io;

use bytes::Bytes;
use object_store::ObjectStoreExt;
use spec::Digest;

use crate::objects::file::measure;
use crate::objects::parse;
use crate::{ObjectWriter, Store, StoreError, StoredObject};

impl Store {
    /// Publishes `bytes` under `path`.
    ///
    /// # Errors
    /// When the disk is full or fails; nothing lies under `path` then.
    pub async fn put_object(&self, path: &str, bytes: Bytes) -> Result<StoredObject, StoreError> {
        let object = StoredObject {
            path: path.to_owned(),
            size: bytes.len() as u64,
            sha256: Digest::of(&bytes),
        };
        self.objects()
            .remote()
            .put(&parse(path)?, bytes.into())
            .await
            .map_err(StoreError::object("writing", path))?;
        Ok(object)
    }

    /// Begins an object that is written piece by piece.
    ///
    /// # Errors
    /// When the disk is full or fails.
    pub async fn write_object(&self, path: &str) -> Result<ObjectWriter, StoreError> {
        let path = parse(path)?.to_string();
        match self.objects().folder() {
            Some(folder) => {
                let folder = folder.to_owned();
                let failed = StoreError::file("writing", &path);
                tokio::task::spawn_blocking(move || ObjectWriter::in_store(&folder, &path))
                    .await
                    .map_err(|error| failed(io::Error::other(error)))?
            }
            None => ObjectWriter::elsewhere(self.objects().remote(), &path).await,
        }
    }

    /// Reads an object whole and checks its digest.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when it has other bytes than were published; when it cannot be read.
    pub async fn read_object(&self, object: &StoredObject) -> Result<Bytes, StoreError> {
        let failed = || StoreError::object("reading", &object.path);
        let found = self.objects().remote().get(&parse(&object.path)?).await.map_err(failed())?;
        let version = found.meta.clone();
        object.check_size(version.size)?;
        let bytes = found.bytes().await.map_err(failed())?;
        self.objects().checked.judge(object, &version, Digest::of(&bytes))?;
        Ok(bytes)
    }

    /// Reads all of an object's bytes to learn their size and digest, whatever they were. Blocks.
    ///
    /// # Errors
    /// When it is not there or cannot be read.
    pub fn measure_object(&self, path: &str) -> Result<StoredObject, StoreError> {
        measure(&self.objects().open(path)?, path)
    }
}
