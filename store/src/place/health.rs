//! Health of the store: whether it can be written to, and whether there is room for more.

use std::time::Duration;

use crate::boxed;
use crate::database::Scope;
use crate::objects::RemoteStore;
use crate::place::disk::{DiskSpace, FileIdentity};
use crate::{Store, StoreError};

/// Time limit of a trivial write.
const WRITE_WITHIN: Duration = Duration::from_secs(2);

impl Store {
    /// Writes to the database, and checks that its file is still the one that was opened.
    ///
    /// # Errors
    /// [`StoreError::DatabaseGone`] when the file was deleted or replaced.
    /// [`StoreError::DatabaseBusy`] when the database accepts no write within two seconds. The
    /// database's own error when it is read-only or damaged.
    #[boxed]
    pub async fn check_database(&self) -> Result<(), StoreError> {
        self.check_database_file()?;
        let write = async {
            let mut tx = self.begin(Scope::Rows, "trying to write").await?;
            tx.probe().await?;
            tx.commit().await
        };
        let written = tokio::time::timeout(WRITE_WITHIN, write).await;
        written.unwrap_or(Err(StoreError::DatabaseBusy { waited: WRITE_WITHIN }))
    }

    /// # Errors
    /// When the operating system reports an error.
    pub fn disk_space(&self) -> Result<DiskSpace, StoreError> {
        let dir = self.dir();
        DiskSpace::of(dir.path()).map_err(|reason| dir.unusable(reason))
    }

    /// Space on the disk that results are written to. `None` if they are sent to a bucket.
    ///
    /// # Errors
    /// When the operating system reports an error.
    pub fn disk_space_of_results(&self) -> Result<Option<DiskSpace>, StoreError> {
        let is_in_folder = self.objects().away().is_none();
        is_in_folder.then(|| self.disk_space()).transpose()
    }

    /// Why no worker should claim a task at the moment, in one line.
    pub fn obstacle(&self) -> Option<String> {
        if let Err(error) = self.check_database_file() {
            return Some(error.to_string());
        }
        if let Some(obstacle) = self.objects().away().and_then(RemoteStore::obstacle) {
            return Some(obstacle);
        }
        if let Some(displaced) = self.objects().displaced() {
            return Some(displaced.obstacle().to_owned());
        }
        let space = self.disk_space().ok().filter(DiskSpace::is_low)?;
        Some(format!(
            "the disk of the data folder has {} MB free, but tasks are only claimed with {} MB or \
             more",
            space.free_bytes / 1_000_000,
            space.reserved_bytes / 1_000_000
        ))
    }

    fn check_database_file(&self) -> Result<(), StoreError> {
        let Some(opened) = self.database_file() else { return Ok(()) };
        match FileIdentity::of(&self.dir().database()) {
            Ok(found) if found == opened => Ok(()),
            Ok(_) | Err(_) => Err(StoreError::DatabaseGone),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Access;

    #[tokio::test]
    async fn a_database_that_was_deleted_or_replaced_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Access::Server).await.unwrap();
        store.check_database().await.unwrap();
        assert_eq!(store.obstacle(), None);

        let file = folder.path().join("torqued.sqlite");
        let bytes = std::fs::read(&file).unwrap();
        std::fs::remove_file(&file).unwrap();
        let gone = |error: &StoreError| matches!(error, StoreError::DatabaseGone);
        assert!(gone(&store.check_database().await.unwrap_err()));
        std::fs::write(&file, bytes).unwrap();
        assert!(gone(&store.check_database().await.unwrap_err()));
        assert!(store.obstacle().unwrap().contains("deleted or replaced"));
    }

    #[tokio::test]
    async fn a_database_that_another_process_holds_is_busy() {
        use sqlx::{ConnectOptions, Executor};
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Access::Server).await.unwrap();
        let file = folder.path().join("torqued.sqlite");
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(file);
        let mut other = options.connect().await.unwrap();
        other.execute("BEGIN IMMEDIATE").await.unwrap();
        let error = store.check_database().await.unwrap_err();
        assert!(matches!(error, StoreError::DatabaseBusy { .. }), "{error}");
        other.execute("ROLLBACK").await.unwrap();
        store.check_database().await.unwrap();
    }
}
