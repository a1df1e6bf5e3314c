//! Waiting for a task without asking all the time.

use std::time::Duration;

use crate::database::Database;
use crate::{Store, StoreError, postgres, sqlite};

/// Rings when tasks were queued.
#[derive(Debug)]
pub struct Bell(Inner);

#[derive(Debug)]
enum Inner {
    Sqlite(sqlite::Bell),
    Postgres(postgres::Bell),
}

impl Store {
    /// Tasks that are queued from now on ring. With PostgreSQL a bell is a connection: drop it while there is work.
    ///
    /// # Errors
    /// When the database does not answer.
    pub async fn bell(&self) -> Result<Bell, StoreError> {
        const OPERATION: &str = "listening for tasks";
        Ok(Bell(match self.database() {
            Database::Sqlite(database) => Inner::Sqlite(database.bell()),
            Database::Postgres(database) => {
                let bell = database.bell().await.map_err(StoreError::database(OPERATION))?;
                Inner::Postgres(bell)
            }
        }))
    }
}

impl Bell {
    /// Returns when it rings, and after `longest` at the latest: a task that may be claimed from a moment on rings for nobody.
    ///
    /// # Errors
    /// When the database does not answer; make another bell then.
    pub async fn wait(&mut self, longest: Duration) -> Result<(), StoreError> {
        match &mut self.0 {
            Inner::Sqlite(bell) => {
                bell.wait(longest).await;
                Ok(())
            }
            Inner::Postgres(bell) => {
                bell.wait(longest).await.map_err(StoreError::database("waiting for a task"))
            }
        }
    }
}
