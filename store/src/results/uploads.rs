//! Uploads: files that were sent to be imported. Each is kept once, under its digest.

use std::fs::File;
use std::io;

use object_store::path::Path;
use object_store::{ObjectStoreExt, WriteMultipart};
use sha2::{Digest as _, Sha256};
use spec::Digest;
use tokio::io::AsyncWriteExt;

use crate::database::query::{from_row, sql};
use crate::database::{Scope, Transaction};
use crate::objects::{UnfinishedCopy, path, unique_name};
use crate::place::disk::LastRoom;
use crate::{Store, StoreError, StoredObject, Timestamp, boxed};

/// A file that a user sent for imports.
#[derive(Clone, Debug)]
pub struct Upload {
    /// The name that the sender gave it. For a file that was sent twice, the first name.
    pub name: String,
    /// Its bytes.
    pub object: StoredObject,
    /// When it was first sent.
    pub created_at: Timestamp,
}

/// Receives a file in pieces. If it is dropped before [`UploadWriter::finish`], it leaves nothing.
#[derive(Debug)]
pub struct UploadWriter {
    store: Store,
    to: Destination,
    path: String,
    size: u64,
    digest: Sha256,
    room: LastRoom,
}

#[derive(Debug)]
enum Destination {
    /// A file in the data folder.
    Folder(WriteMultipart),
    /// A file that will be published to a remote store.
    Remote(tokio::fs::File, UnfinishedCopy),
}

/// Number of bytes that are handed to the disk at once.
const PART_SIZE: usize = 8 * 1024 * 1024;

/// Number of parts that are written at a time. It bounds memory.
const PARTS_IN_FLIGHT: usize = 2;

impl Store {
    /// Begins to receive a file.
    ///
    /// # Errors
    /// When the disk is full or fails.
    #[boxed]
    pub async fn begin_upload(&self) -> Result<UploadWriter, StoreError> {
        self.receive(path::UPLOAD).await
    }

    /// Begins to receive an object whose path begins with `prefix`.
    pub(crate) async fn receive(&self, prefix: &str) -> Result<UploadWriter, StoreError> {
        self.objects().check_place().await?;
        // The digest is not known before the end.
        let path = unique_name(prefix);
        let to = match self.objects().away() {
            Some(elsewhere) => {
                let copy = elsewhere.begin(&path)?;
                let file = copy.file().try_clone().map_err(StoreError::file("writing", &path))?;
                Destination::Remote(file.into(), copy)
            }
            None => {
                let parts = self.objects().remote().put_multipart(&Path::from(path.as_str())).await;
                let parts = parts.map_err(StoreError::object("writing", &path))?;
                Destination::Folder(WriteMultipart::new_with_chunk_size(parts, PART_SIZE))
            }
        };
        let room = LastRoom::of(self.dir().path());
        Ok(UploadWriter { store: self.clone(), to, path, size: 0, digest: Sha256::new(), room })
    }

    /// The upload with this digest.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn upload(&self, sha256: Digest) -> Result<Option<Upload>, StoreError> {
        sql("SELECT * FROM upload WHERE sha256 = $1")
            .bind(sha256.to_string())
            .optional(&mut self.read("looking up an upload"))
            .await
    }

    /// Makes a found object an upload under its digest again, unless there is one.
    ///
    /// # Errors
    /// When the object does not exist, or the database fails.
    #[boxed]
    pub async fn adopt_upload(&self, object: &StoredObject) -> Result<(), StoreError> {
        if self.upload(object.sha256).await?.is_some() {
            return Ok(());
        }
        // The name that its sender gave it is lost.
        self.commit_upload(&object.sha256.to_string(), object).await.map(drop)
    }

    /// The newest uploads.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn newest_uploads(&self, limit: u32) -> Result<Vec<Upload>, StoreError> {
        sql("SELECT * FROM upload ORDER BY created_at DESC, sha256 LIMIT $1")
            .bind(limit)
            .all(&mut self.read("reading uploads"))
            .await
    }

    /// The size in bytes of all sent files, for imports and for tracked runs. Files in the trash
    /// count until they are deleted permanently.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn sent_bytes(&self) -> Result<u64, StoreError> {
        let bytes: i64 = sql("SELECT (SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM upload) \
             + (SELECT CAST(COALESCE(SUM(size), 0) AS BIGINT) FROM tracked_artifact)")
        .one(&mut self.read("adding up the files that were sent"))
        .await?;
        Ok(bytes.unsigned_abs())
    }

    /// Opens an upload after checking all its bytes against its digest. Blocks.
    ///
    /// # Errors
    /// When it cannot be read, or its bytes differ from those that were received.
    pub fn open_upload(&self, upload: &Upload) -> Result<File, StoreError> {
        self.objects().open_verified(&upload.object)
    }

    /// Makes a published object an upload under its digest, unless there is one.
    async fn commit_upload(&self, name: &str, object: &StoredObject) -> Result<Upload, StoreError> {
        self.objects().verify_published(object).await?;
        let mut tx = self.begin(Scope::Rows, "committing an upload").await?;
        if let Some(known) = tx.known_upload(object.sha256).await?
            && self.objects().verify_published(&known.object).await.is_ok()
        {
            drop(tx);
            self.objects().delete(vec![object.path.clone()]).await;
            return Ok(known);
        }
        let upload = tx.insert_upload(name, object).await?;
        tx.commit().await?;
        Ok(upload)
    }
}

impl UploadWriter {
    /// Number of bytes received so far.
    pub const fn size(&self) -> u64 {
        self.size
    }

    /// SHA-256 of the bytes received so far.
    pub fn digest(&self) -> Digest {
        Digest::from_bytes(self.digest.clone().finalize().into())
    }

    /// # Errors
    /// When the disk is full or fails.
    #[boxed]
    pub async fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.room.before(bytes.len()).map_err(StoreError::file("writing", &self.path))?;
        match &mut self.to {
            Destination::Folder(parts) => {
                let room = parts.wait_for_capacity(PARTS_IN_FLIGHT).await;
                room.map_err(StoreError::object("writing", &self.path))?;
                // The bytes are copied, because a sender that cuts a body into single bytes must
                // not make each of them an object.
                parts.write(bytes);
            }
            Destination::Remote(file, _) => {
                let written = file.write_all(bytes).await;
                written.map_err(StoreError::file("writing", &self.path))?;
            }
        }
        self.digest.update(bytes);
        self.size += bytes.len() as u64;
        Ok(())
    }

    /// Syncs, publishes and commits the received bytes. If they exist under another name, they keep
    /// that name.
    ///
    /// # Errors
    /// When the disk is full or fails, or the object store refuses or does not answer. There is no
    /// upload then.
    #[boxed]
    pub async fn finish(self, name: &str) -> Result<Upload, StoreError> {
        let (store, object) = self.into_object().await?;
        store.commit_upload(name, &object).await
    }

    /// Syncs and publishes the received bytes.
    pub(crate) async fn into_object(self) -> Result<(Store, StoredObject), StoreError> {
        let sha256 = self.digest();
        let object = StoredObject { path: self.path, size: self.size, sha256 };
        match self.to {
            Destination::Folder(parts) => {
                parts.finish().await.map_err(StoreError::object("writing", &object.path))?;
            }
            Destination::Remote(mut file, copy) => {
                file.flush().await.map_err(StoreError::file("writing", &object.path))?;
                publish(self.store.clone(), copy, object.clone()).await?;
            }
        }
        Ok((self.store, object))
    }
}

/// Publishes even if nobody waits for it any more, so that what was begun is published or given up
/// in order.
async fn publish(
    store: Store,
    copy: UnfinishedCopy,
    object: StoredObject,
) -> Result<(), StoreError> {
    let failed = StoreError::file("writing", &object.path);
    let publish = move || match store.objects().away() {
        Some(elsewhere) => elsewhere.publish(copy, &object),
        None => Ok(()),
    };
    let published = tokio::task::spawn_blocking(publish).await;
    published.map_err(|error| failed(io::Error::other(error)))?
}

impl Transaction {
    pub async fn known_upload(&mut self, sha256: Digest) -> Result<Option<Upload>, StoreError> {
        sql("SELECT * FROM upload WHERE sha256 = $1").bind(sha256.to_string()).optional(self).await
    }

    /// An existing row has lost its object, so it gets this one.
    pub async fn insert_upload(
        &mut self,
        name: &str,
        object: &StoredObject,
    ) -> Result<Upload, StoreError> {
        sql("INSERT INTO upload (sha256, name, path, size, created_at) \
             VALUES ($1, $2, $3, $4, {now}) ON CONFLICT (sha256) DO UPDATE \
             SET path = excluded.path RETURNING *")
        .bind(object.sha256.to_string())
        .bind(name)
        .bind(&object.path)
        .bind(object.size)
        .one(self)
        .await
    }
}

from_row!(Upload { name, created_at, ..row => object: StoredObject::from_row(row)? });
