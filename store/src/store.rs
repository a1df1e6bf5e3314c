use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use object_store::ObjectStore;

use crate::data_dir::DataDir;
use crate::database::{Database, sql};
use crate::health::FileIdentity;
use crate::objects::Objects;
use crate::{Access, StoreError};

/// A data folder, open. Clones share it; several processes may have the same folder open.
#[derive(Clone, Debug)]
pub struct Store {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    dir: DataDir,
    database: Database,
    /// As it was opened.
    database_file: FileIdentity,
    objects: Objects,
    /// Held for as long as any clone lives.
    _lock: Option<File>,
}

impl Store {
    /// # Errors
    /// When the folder cannot be written, is served by another process, has no store yet (for a
    /// worker), comes from a newer version or is damaged. Nothing is changed in the last two.
    pub async fn open(dir: &Path, access: Access) -> Result<Self, StoreError> {
        Self::open_with(DataDir::new(dir), access, Objects::in_folder).await
    }

    /// The same with objects that lie in `objects` instead of the folder.
    ///
    /// # Errors
    /// As [`Store::open`].
    pub async fn open_with_objects(
        dir: &Path,
        access: Access,
        objects: Arc<dyn ObjectStore>,
    ) -> Result<Self, StoreError> {
        let elsewhere = |dir: &DataDir| Ok(Objects::elsewhere(dir, objects));
        Self::open_with(DataDir::new(dir), access, elsewhere).await
    }

    async fn open_with(
        dir: DataDir,
        access: Access,
        objects: impl FnOnce(&DataDir) -> Result<Objects, StoreError>,
    ) -> Result<Self, StoreError> {
        let lock = match access {
            Access::Server => {
                dir.create()?;
                Some(dir.lock()?)
            }
            Access::Worker => None,
        };
        let database = Database::open(&dir, access).await?;
        let file = FileIdentity::of(&dir.database());
        let database_file = file.map_err(|reason| dir.unusable(reason))?;
        let objects = objects(&dir)?;
        Ok(Self { inner: Arc::new(Inner { dir, database, database_file, objects, _lock: lock }) })
    }

    /// Version of the database's schema, as this binary knows it.
    pub fn schema_version(&self) -> i64 {
        self.database().known_schema()
    }

    /// Whether the database answers.
    ///
    /// # Errors
    /// When it does not.
    pub async fn ping(&self) -> Result<(), StoreError> {
        sql!(self.database(), "asking whether it is there", ping())
    }

    /// Ends all connections; SQLite then folds its write-ahead log into the database.
    pub async fn close(&self) {
        self.inner.database.close().await;
    }

    pub(crate) fn dir(&self) -> &DataDir {
        &self.inner.dir
    }

    pub(crate) fn database_file(&self) -> FileIdentity {
        self.inner.database_file
    }

    pub(crate) fn database(&self) -> &Database {
        &self.inner.database
    }

    pub(crate) fn objects(&self) -> &Objects {
        &self.inner.objects
    }
}
