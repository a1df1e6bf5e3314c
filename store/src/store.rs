//! An open store.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use crate::boxed;
use crate::database::query::sql;
use crate::database::{Database, Reading, Scope, Transaction};
use crate::objects::Objects;
use crate::place::data_dir::DataDir;
use crate::place::disk::FileIdentity;
use crate::place::new_place;
use crate::{Access, Location, RemoteObjects, S3Options, StoreError, Timestamp};

/// An open store: the one door to everything that lasts. Clones share it, and several processes may
/// have the same store open.
///
/// ```
/// use std::time::Duration;
///
/// use serde_json::json;
/// use spec::Resources;
/// use store::{Access, JobState, NewJob, NewTask, Store, Submission};
///
/// # #[tokio::main(flavor = "current_thread")]
/// # async fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let folder = tempfile::tempdir()?;
/// let store = Store::open(folder.path(), Access::Server).await?;
/// let payload = json!({"from": 1});
/// let task = NewTask { stage: 0, ordinal: 0, label: "count".to_owned(), payload, total: 3 };
/// let job = NewJob { tasks: vec![task], ..NewJob::new("count", json!({"to": 3})) };
/// let id = store.submit(Submission::of(job)).await?.job;
/// let job = store.job(id).await?;
/// assert_eq!((job.kind.as_str(), job.state), ("count", JobState::Queued));
///
/// // A worker leases the task for ten seconds, does it, and completes it.
/// let claimed = store.claim("worker-1", &Resources::default(), Duration::from_secs(10)).await?;
/// let claimed = claimed.expect("a queued task");
/// store.complete(claimed.fence, Some(&json!({"counted": 3}))).await?;
/// assert_eq!(store.job(id).await?.state, JobState::Succeeded);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Store {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    dir: DataDir,
    database: Database,
    /// The identity of SQLite's file when it was opened.
    database_file: Option<FileIdentity>,
    objects: Objects,
    /// Held as long as any clone lives.
    _lock: Option<File>,
}

impl Store {
    /// Opens a store in a folder.
    ///
    /// # Errors
    /// When the folder cannot be written, is served by another process, has no store yet (for a
    /// worker), was written by a newer version or is damaged. In the last two cases nothing is
    /// changed.
    #[boxed]
    pub async fn open(dir: &Path, access: Access) -> Result<Self, StoreError> {
        Self::open_at(&Location::in_folder(dir), access).await
    }

    /// Opens a store.
    ///
    /// # Errors
    /// Like [`Store::open`]. [`StoreError::DatabaseUnusable`] when the database cannot be reached
    /// or refuses the user. It also fails when the bucket, or an environment variable about it,
    /// cannot be used.
    #[boxed]
    pub async fn open_at(location: &Location, access: Access) -> Result<Self, StoreError> {
        match &location.objects {
            None => Self::open_with(location, access, None).await,
            Some(url) => {
                let objects = url.connect(&S3Options::from_env()?).await?;
                Self::open_with_objects(location, access, objects).await
            }
        }
    }

    /// Opens a store with objects in `objects` instead of the folder.
    ///
    /// # Errors
    /// Like [`Store::open_at`].
    #[boxed]
    pub async fn open_with_objects(
        location: &Location,
        access: Access,
        objects: RemoteObjects,
    ) -> Result<Self, StoreError> {
        Self::open_with(location, access, Some(objects)).await
    }

    async fn open_with(
        location: &Location,
        access: Access,
        remote: Option<RemoteObjects>,
    ) -> Result<Self, StoreError> {
        let dir = DataDir::new(&location.folder);
        let is_shared = location.database.is_some();
        if access.is_owner() && !is_shared {
            new_place::check_folder(&dir, location, access)?;
            dir.create()?;
        }
        // Servers that share a database agree through it instead of a lock.
        let lock = (access.is_owner() && !is_shared).then(|| dir.lock()).transpose()?;
        let database = Database::open(&dir, location.database.as_ref(), access).await?;
        if access.is_owner() && is_shared {
            if remote.is_none() {
                new_place::refuse_lost_folder(&dir, &database, location).await?;
            }
            new_place::check_folder(&dir, location, access)?;
        }
        let file = (!is_shared).then(|| FileIdentity::of(&dir.database())).transpose();
        let database_file = file.map_err(|reason| dir.unusable(reason))?;
        let objects = match remote {
            Some(remote) => {
                dir.create()?;
                dir.create_objects()?;
                Objects::elsewhere(&dir, remote)?
            }
            None => {
                if !dir.objects().is_dir() {
                    if !access.is_owner() {
                        let place = dir.objects().display().to_string();
                        return Err(new_place::no_files(place, "does not exist"));
                    }
                    new_place::refuse_lost_folder(&dir, &database, location).await?;
                    dir.create()?;
                    dir.create_objects()?;
                }
                Objects::in_folder(&dir)?
            }
        };
        let inner = Inner { dir, database, database_file, objects, _lock: lock };
        let store = Self { inner: Arc::new(inner) };
        store.check_objects(location, access).await?;
        if access == Access::Server {
            store.fold_names().await?;
        }
        Ok(store)
    }

    /// The version of the database schema that this binary knows.
    pub fn schema_version(&self) -> i64 {
        self.database().known_schema()
    }

    /// Whether the database answers.
    ///
    /// # Errors
    /// When it does not.
    #[boxed]
    pub async fn ping(&self) -> Result<(), StoreError> {
        sql("SELECT 1").rows(&mut self.read("asking whether it is there")).await.map(drop)
    }

    /// The current moment by the database's clock.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn now(&self) -> Result<Timestamp, StoreError> {
        sql("SELECT {now}").one(&mut self.read("reading the clock")).await
    }

    /// Closes all connections. SQLite then merges its write-ahead log into the database.
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

    /// Reads outside of a transaction.
    pub(crate) fn read(&self, operation: &'static str) -> Reading<'_> {
        self.database().read(operation)
    }

    /// Begins a transaction that reads the state of one moment while others write.
    pub(crate) async fn begin_snapshot(
        &self,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        self.database().begin_snapshot(operation).await
    }

    pub(crate) async fn begin(
        &self,
        scope: Scope,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        self.database().begin(scope, operation).await
    }

    pub(crate) fn objects(&self) -> &Objects {
        &self.inner.objects
    }
}
