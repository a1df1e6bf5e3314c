//! Writing and reading objects.

use std::io::{self, Read};

use bytes::Bytes;
use object_store::ObjectStoreExt;
use spec::Digest;

use crate::boxed;
use crate::objects::cache::KEPT_FROM;
use crate::objects::parse;
use crate::{ObjectWriter, Store, StoreError, StoredObject};

impl Store {
    /// Publishes `bytes` under `path`. In a bucket, an object is never replaced by another one.
    ///
    /// # Errors
    /// When the disk is full or fails, or the object store refuses or does not answer. Nothing lies
    /// under `path` then. [`StoreError::ObjectTaken`] when another object lies there.
    /// [`StoreError::Displaced`] when the place is not that of this store any more.
    #[boxed]
    pub async fn put_object(&self, path: &str, bytes: Bytes) -> Result<StoredObject, StoreError> {
        self.objects().check_place().await?;
        let object = StoredObject {
            path: path.to_owned(),
            size: bytes.len() as u64,
            sha256: Digest::of(&bytes),
        };
        match self.objects().away() {
            Some(elsewhere) => elsewhere.put(&object, bytes).await?,
            None => {
                let put = self.objects().remote().put(&parse(path)?, bytes.into()).await;
                put.map_err(StoreError::object("writing", path))?;
            }
        }
        Ok(object)
    }

    /// Begins an object whose bytes are written in pieces.
    ///
    /// # Errors
    /// When the disk is full or fails.
    #[boxed]
    pub async fn write_object(&self, path: &str) -> Result<ObjectWriter, StoreError> {
        let (store, path) = (self.clone(), parse(path)?.to_string());
        let failed = StoreError::file("writing", &path);
        tokio::task::spawn_blocking(move || ObjectWriter::in_store(&store, &path))
            .await
            .map_err(|error| failed(io::Error::other(error)))?
    }

    /// Reads a whole object and checks its digest.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when its bytes differ from those that were published. It also
    /// fails when the object cannot be read.
    #[boxed]
    pub async fn read_object(&self, object: &StoredObject) -> Result<Bytes, StoreError> {
        if self.objects().away().is_some() && object.size >= KEPT_FROM {
            return self.read_copy(object.clone()).await;
        }
        let failed = || StoreError::object("reading", &object.path);
        let found = self.objects().remote().get(&parse(&object.path)?).await.map_err(failed())?;
        let version = found.meta.clone();
        object.check_size(version.size)?;
        let bytes = found.bytes().await.map_err(failed())?;
        self.objects().checked.judge(object, &version, Digest::of(&bytes))?;
        Ok(bytes)
    }

    /// Reads an object to learn its size and digest, without checking them. Blocks.
    ///
    /// # Errors
    /// When it does not exist or cannot be read.
    pub fn measure_object(&self, path: &str) -> Result<StoredObject, StoreError> {
        self.objects().measure(path)
    }

    async fn read_copy(&self, object: StoredObject) -> Result<Bytes, StoreError> {
        let store = self.clone();
        let failed = StoreError::file("reading", &object.path);
        let read = move || {
            let mut bytes = Vec::with_capacity(usize::try_from(object.size).unwrap_or_default());
            let read = store.objects().open_verified(&object)?.read_to_end(&mut bytes);
            read.map_err(StoreError::file("reading", &object.path))?;
            Ok(bytes.into())
        };
        let read = tokio::task::spawn_blocking(read).await;
        read.map_err(|error| failed(io::Error::other(error)))?
    }
}
