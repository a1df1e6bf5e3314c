use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use crate::boxed;
use crate::data_dir::DataDir;
use crate::database::{Database, sql};
use crate::health::FileIdentity;
use crate::objects::Objects;
use crate::{Access, Location, RemoteObjects, S3Options, StoreError};

/// A data folder, open. Clones share it; several processes may have the same folder open.
#[derive(Clone, Debug)]
pub struct Store {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    dir: DataDir,
    database: Database,
    /// SQLite's, as it was opened.
    database_file: Option<FileIdentity>,
    objects: Objects,
    /// Held for as long as any clone lives.
    _lock: Option<File>,
}

impl Store {
    /// Opens a store that lies in a folder.
    ///
    /// # Errors
    /// When the folder cannot be written, is served by another process, has no store yet (for a
    /// worker), comes from a newer version or is damaged. Nothing is changed in the last two.
    #[boxed]
    pub async fn open(dir: &Path, access: Access) -> Result<Self, StoreError> {
        Self::open_at(&Location::in_folder(dir), access).await
    }

    /// Opens a store.
    ///
    /// # Errors
    /// As [`Store::open`]; [`StoreError::DatabaseUnusable`] when the database cannot be reached or does not let the user in;
    /// what is wrong with the bucket, or with the environment's variables that say how to reach it.
    #[boxed]
    pub async fn open_at(location: &Location, access: Access) -> Result<Self, StoreError> {
        match &location.objects {
            None => Self::open_with(location, access, Objects::in_folder).await,
            Some(url) => {
                let objects = url.connect(&S3Options::from_env()?).await?;
                Self::open_with_objects(location, access, objects).await
            }
        }
    }

    /// The same with objects that lie in `objects` instead of the folder.
    ///
    /// # Errors
    /// As [`Store::open_at`].
    #[boxed]
    pub async fn open_with_objects(
        location: &Location,
        access: Access,
        objects: RemoteObjects,
    ) -> Result<Self, StoreError> {
        let elsewhere = |dir: &DataDir| Objects::elsewhere(dir, objects);
        Self::open_with(location, access, elsewhere).await
    }

    async fn open_with(
        location: &Location,
        access: Access,
        objects: impl FnOnce(&DataDir) -> Result<Objects, StoreError>,
    ) -> Result<Self, StoreError> {
        let dir = DataDir::new(&location.folder);
        let is_shared = location.database.is_some();
        if access.is_owner() || is_shared {
            dir.create()?;
        }
        // Servers that share a database agree through it.
        let lock = (access.is_owner() && !is_shared).then(|| dir.lock()).transpose()?;
        let database = Database::open(&dir, location.database.as_ref(), access).await?;
        let file = (!is_shared).then(|| FileIdentity::of(&dir.database())).transpose();
        let database_file = file.map_err(|reason| dir.unusable(reason))?;
        let objects = objects(&dir)?;
        let inner = Inner { dir, database, database_file, objects, _lock: lock };
        let store = Self { inner: Arc::new(inner) };
        store.check_objects(access).await?;
        if access == Access::Server {
            store.fold_names().await?;
        }
        Ok(store)
    }

    /// Version of the database's schema, as this binary knows it.
    pub fn schema_version(&self) -> i64 {
        self.database().known_schema()
    }

    /// Whether the database answers.
    ///
    /// # Errors
    /// When it does not.
    #[boxed]
    pub async fn ping(&self) -> Result<(), StoreError> {
        sql!(self.database(), "asking whether it is there", ping())
    }

    /// Ends all connections; SQLite then folds its write-ahead log into the database.
    #[boxed]
    pub async fn close(&self) {
        self.inner.database.close().await;
    }

    pub(crate) fn dir(&self) -> &DataDir {
        &self.inner.dir
    }

    pub(crate) fn database_file(&self) -> Option<FileIdentity> {
        self.inner.database_file
    }

    pub(crate) fn database(&self) -> &Database {
        &self.inner.database
    }

    pub(crate) fn objects(&self) -> &Objects {
        &self.inner.objects
    }
}
