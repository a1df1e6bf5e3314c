//! Fetching remote objects into local files, because Parquet is read at positions.

use std::fs::File;
use std::io::{self, Seek, Write};

use futures::TryStreamExt;
use object_store::path::Path;
use object_store::{GetOptions, GetRange, ObjectMeta, ObjectStoreExt};
use sha2::{Digest as _, Sha256};
use spec::Digest;

use super::away::RemoteStore;
use super::cache::CacheSlot;
use super::checked::CheckedObjects;
use super::parse;
use super::publish::digest_of;
use crate::{StoreError, StoredObject};

/// How often a fetch continues where it broke off. Only tries that made progress count.
const GOES_ON: u32 = 16;

/// An object that is being fetched into a file.
struct Fetch<'a> {
    object: &'a StoredObject,
    location: Path,
    file: &'a File,
    /// The object's version when its first bytes came.
    version: Option<ObjectMeta>,
    fetched: u64,
    digest: Sha256,
}

impl RemoteStore {
    /// Opens a copy of an object. Its bytes were compared with its digest when they were fetched.
    /// Blocks.
    ///
    /// # Errors
    /// [`StoreError::DamagedObject`] when the bytes differ from those that were published. It also
    /// fails when the store refuses or does not answer, or when the disk is full or fails.
    pub fn open_verified(
        &self,
        object: &StoredObject,
        checked: &CheckedObjects,
    ) -> Result<File, StoreError> {
        let failed = || StoreError::file("keeping a copy of", &object.path);
        let wait = || self.cache.place(object.sha256, object.size);
        let copy = match tokio::task::block_in_place(wait).map_err(failed())? {
            CacheSlot::Taken(file) => return Ok(file),
            CacheSlot::Free(copy) => copy,
        };
        let is_kept = self.cache.make_room(object.size).map_err(failed())?;
        self.block_on(self.fetch(object, copy.file(), checked))?;
        if is_kept { self.cache.keep(copy, object.sha256) } else { copy.reader() }.map_err(failed())
    }

    /// Opens a copy of an object without checking its bytes. The copy is deleted when it is closed.
    /// Blocks.
    ///
    /// # Errors
    /// Like [`Self::open_verified`], without the check for damage.
    pub fn open(&self, path: &str) -> Result<File, StoreError> {
        let failed = || StoreError::file("copying", path);
        let location = parse(path)?;
        let copy = self.cache.begin().map_err(failed())?;
        let fetch = async {
            let object = || StoreError::object("reading", path);
            let found = self.remote.get(&location).await.map_err(object())?;
            let mut left = found.meta.size;
            let mut pieces = found.into_stream();
            while let Some(piece) = pieces.try_next().await.map_err(object())? {
                left = left.checked_sub(piece.len() as u64).ok_or_else(|| failed()(longer()))?;
                copy.file().write_all(&piece).map_err(failed())?;
            }
            if left == 0 { Ok(()) } else { Err(failed()(shorter(left))) }
        };
        self.block_on(fetch)?;
        copy.reader().map_err(failed())
    }

    /// The size and digest of an object's bytes, without checking them. Blocks.
    ///
    /// # Errors
    /// When the store refuses or does not answer.
    pub fn measure(&self, path: &str) -> Result<StoredObject, StoreError> {
        let location = parse(path)?;
        let measured = self.block_on(digest_of(&*self.remote, &location));
        let (size, sha256) = measured.map_err(StoreError::object("reading", path))?;
        Ok(StoredObject { path: path.to_owned(), size, sha256 })
    }

    /// Fetches a whole object. If its bytes differ from those that were published, it is fetched
    /// again, because they may have changed on the way.
    async fn fetch(
        &self,
        object: &StoredObject,
        file: &File,
        checked: &CheckedObjects,
    ) -> Result<(), StoreError> {
        match self.fetch_once(object, file).await {
            Ok((_, found)) if found == object.sha256 => return Ok(()),
            Ok(_) | Err(StoreError::DamagedObject { .. }) => {}
            Err(error) => return Err(error),
        }
        tracing::warn!(path = object.path, "an object came damaged; it is fetched again");
        start_anew(file).map_err(StoreError::file("keeping a copy of", &object.path))?;
        let (version, found) = self.fetch_once(object, file).await?;
        checked.judge(object, &version, found)
    }

    /// Fetches an object once. Returns its version and the digest of its bytes.
    async fn fetch_once(
        &self,
        object: &StoredObject,
        file: &File,
    ) -> Result<(ObjectMeta, Digest), StoreError> {
        let location = parse(&object.path)?;
        let (version, digest) = (None, Sha256::new());
        let mut fetch = Fetch { object, location, file, version, fetched: 0, digest };
        let mut went_on = 0;
        let version = loop {
            let before = fetch.fetched;
            let error = match self.go_on(&mut fetch).await {
                Ok(version) => break version,
                Err(error @ StoreError::DamagedObject { .. }) => return Err(error),
                Err(error) => error,
            };
            went_on += 1;
            if fetch.fetched == before || went_on > GOES_ON {
                return Err(error);
            }
            let (path, at) = (&object.path, fetch.fetched);
            tracing::warn!(path, at, %error, "an object broke off; its rest is fetched");
        };
        Ok((version, Digest::from_bytes(fetch.digest.finalize().into())))
    }

    /// Fetches the missing bytes.
    async fn go_on(&self, fetch: &mut Fetch<'_>) -> Result<ObjectMeta, StoreError> {
        let path = &fetch.object.path;
        let failed = || StoreError::object("reading", path);
        let range = (fetch.fetched > 0).then_some(GetRange::Offset(fetch.fetched));
        let options = GetOptions { range, ..GetOptions::default() };
        let found = self.remote.get_opts(&fetch.location, options).await.map_err(failed())?;
        let version = fetch.version.get_or_insert_with(|| found.meta.clone()).clone();
        fetch.object.check_size(version.size)?;
        let mut pieces = found.into_stream();
        while let Some(piece) = pieces.try_next().await.map_err(failed())? {
            let written = StoreError::file("keeping a copy of", path);
            if fetch.fetched + piece.len() as u64 > fetch.object.size {
                return Err(written(longer()));
            }
            fetch.file.write_all(&piece).map_err(written)?;
            fetch.digest.update(&piece);
            fetch.fetched += piece.len() as u64;
        }
        match fetch.object.size - fetch.fetched {
            0 => Ok(version),
            left => Err(StoreError::file("reading", path)(shorter(left))),
        }
    }
}

fn start_anew(mut file: &File) -> io::Result<()> {
    file.set_len(0)?;
    file.rewind()
}

fn longer() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "more bytes came than it has")
}

pub(super) fn shorter(left: u64) -> io::Error {
    io::Error::new(io::ErrorKind::UnexpectedEof, format!("{left} bytes of it are missing"))
}
