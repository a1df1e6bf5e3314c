//! Publishing remote objects: whole or not at all, and never over another object.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use bytes::Bytes;
use futures::{StreamExt, TryStreamExt};
use object_store::path::Path;
use object_store::{Error, MultipartUpload, ObjectStore, ObjectStoreExt};
use sha2::{Digest as _, Sha256};
use spec::Digest;

use super::away::RemoteStore;
use super::cache::UnfinishedCopy;
use super::parse;
use crate::{StoreError, StoredObject};

/// Size of a part in bytes. It is larger for an object that would have too many parts.
const PART_SIZE: u64 = 8 << 20;

/// The number of parts that S3 allows for an object.
const PARTS: u64 = 10_000;

/// Number of parts that are sent at a time. It bounds memory.
const PARTS_IN_FLIGHT: usize = 4;

impl RemoteStore {
    /// Publishes bytes.
    ///
    /// # Errors
    /// [`StoreError::ObjectTaken`] when an object with other bytes lies there. It also fails when
    /// the store refuses or does not answer.
    pub async fn put(&self, object: &StoredObject, bytes: Bytes) -> Result<(), StoreError> {
        let location = parse(&object.path)?;
        match self.remote.put(&location, bytes.into()).await {
            Ok(_) => Ok(()),
            Err(error) => self.settle(object, &location, error).await,
        }
    }

    /// Publishes a finished file, and keeps it as the cached copy of the object. Blocks.
    ///
    /// # Errors
    /// Like [`Self::put`]. It also fails when the file cannot be read.
    pub fn publish(&self, copy: UnfinishedCopy, object: &StoredObject) -> Result<(), StoreError> {
        // It may have taken hours to write the file.
        if self.mark.is_stale()
            && let Some(found) = self.block_on(self.mark.look_at(&*self.remote))
        {
            let place = self.remote.to_string();
            return Err(StoreError::Displaced { place, found: found.as_str() });
        }
        self.block_on(self.put_file(object, copy.file()))?;
        // The object is published, so an error of the cache does not matter.
        let kept = self.cache.make_room(object.size).and_then(|has_room| {
            if has_room { self.cache.keep(copy, object.sha256).map(drop) } else { Ok(()) }
        });
        if let Err(error) = kept {
            tracing::warn!(path = object.path, %error, "cannot keep a copy of an object");
        }
        Ok(())
    }

    async fn put_file(&self, object: &StoredObject, file: &File) -> Result<(), StoreError> {
        if object.size <= PART_SIZE {
            let failed = StoreError::file("reading what is to be", &object.path);
            let bytes = read_part(file, 0, object.size).map_err(failed)?;
            return self.put(object, bytes).await;
        }
        let location = parse(&object.path)?;
        let upload = self.remote.put_multipart(&location).await;
        let mut upload = upload.map_err(StoreError::object("writing", &object.path))?;
        let Err(error) = send_parts(&mut *upload, file, object.size).await else { return Ok(()) };
        if let Err(error) = upload.abort().await {
            // The upload may be complete after all. Otherwise a rule of the bucket deletes its
            // parts.
            tracing::debug!(path = object.path, %error, "cannot give up an upload in parts");
        }
        self.settle(object, &location, error).await
    }

    /// Ignores the error if an object with the right bytes exists: an earlier request published it,
    /// and its response was lost.
    async fn settle(
        &self,
        object: &StoredObject,
        location: &Path,
        error: Error,
    ) -> Result<(), StoreError> {
        // A completed multipart upload no longer exists, or refuses all requests.
        let is_refusal = matches!(
            error,
            Error::Precondition { .. }
                | Error::AlreadyExists { .. }
                | Error::NotFound { .. }
                | Error::PermissionDenied { .. }
        );
        if !is_refusal {
            return Err(StoreError::object("writing", &object.path)(error));
        }
        match digest_of(&*self.remote, location).await {
            Ok((_, found)) if found == object.sha256 => Ok(()),
            Ok(_) => Err(StoreError::ObjectTaken { path: object.path.clone() }),
            Err(_) => Err(StoreError::object("writing", &object.path)(error)),
        }
    }
}

/// The size and the digest of an object's bytes, without checking them.
pub(super) async fn digest_of(
    remote: &dyn ObjectStore,
    location: &Path,
) -> Result<(u64, Digest), Error> {
    let mut pieces = remote.get(location).await?.into_stream();
    let (mut size, mut digest) = (0, Sha256::new());
    while let Some(piece) = pieces.try_next().await? {
        size += piece.len() as u64;
        digest.update(&piece);
    }
    Ok((size, Digest::from_bytes(digest.finalize().into())))
}

async fn send_parts(upload: &mut dyn MultipartUpload, file: &File, size: u64) -> Result<(), Error> {
    let part_size = PART_SIZE.max(size.div_ceil(PARTS));
    // Parts are read and numbered in this order, as there is room for them.
    let parts = (0..size.div_ceil(part_size)).map(|part| {
        let start = part * part_size;
        read_part(file, start, part_size.min(size - start))
    });
    futures::stream::iter(parts)
        .map(|part| match part {
            Ok(bytes) => upload.put_part(bytes.into()),
            Err(source) => {
                let error = Error::Generic { store: "file", source: Box::new(source) };
                Box::pin(std::future::ready(Err(error)))
            }
        })
        .buffer_unordered(PARTS_IN_FLIGHT)
        .try_collect::<()>()
        .await?;
    upload.complete().await.map(drop)
}

fn read_part(file: &File, start: u64, length: u64) -> io::Result<Bytes> {
    let mut bytes = vec![0; usize::try_from(length).map_err(io::Error::other)?];
    file.read_exact_at(&mut bytes, start)?;
    Ok(bytes.into())
}
