//! Writing and reading objects.

use std::io::{self, Read};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use object_store::ObjectStoreExt;
use spec::Digest;

use crate::boxed;
use crate::objects::cache::KEPT_FROM;
use crate::objects::parse;
use crate::objects::signed::{SignedFor, UrlSigner};
use crate::{ObjectWriter, Store, StoreError, StoredObject};

impl Store {
    /// Begins to fetch an object that will be opened soon, unless several are being fetched
    /// already. Does nothing if objects are local files.
    pub fn fetch_ahead(&self, object: &StoredObject) {
        let Some(elsewhere) = self.objects().away() else { return };
        let Ok(turn) = Arc::clone(&elsewhere.ahead).try_acquire_owned() else { return };
        let (store, object) = (self.clone(), object.clone());
        elsewhere.runtime.spawn_blocking(move || {
            let _turn = turn;
            // An error is reported when the object is opened.
            drop(store.objects().open_verified(&object));
        });
    }

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

    /// A URL from which anybody can fetch the object, or ranges of it, for the given time. `None`
    /// where objects do not lie in a bucket. The bytes are not compared with their digest on the
    /// way.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when the object has another size or was found damaged. It also
    /// fails when the object does not exist.
    #[boxed]
    pub async fn signed_url(
        &self,
        object: &StoredObject,
        method: SignedFor,
        valid_for: Duration,
    ) -> Result<Option<String>, StoreError> {
        let signer = self.objects().away().and_then(|elsewhere| elsewhere.signer.as_ref());
        let Some(UrlSigner { bucket, prefix }) = signer else { return Ok(None) };
        self.look_up_object(object).await?;
        let method = match method {
            SignedFor::Get => object_store::signer::Method::GET,
            SignedFor::Head => object_store::signer::Method::HEAD,
        };
        let path = prefix.parts().chain(parse(&object.path)?.parts()).collect();
        let signed = bucket.signed_url(method, &path, valid_for).await;
        signed
            .map(|url| Some(url.into()))
            .map_err(StoreError::object("signing an address of", &object.path))
    }
}
