//! Duties that one server has for all that share a store: two may serve one PostgreSQL, and one of them keeps house.

use crate::boxed;
use crate::database::Database;
use crate::postgres::DutyLock;
use crate::{Store, StoreError};

/// Work that one server at a time does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Duty {
    /// Giving the tasks of dead workers to others.
    Reaping,
    /// Deleting objects without a row.
    Sweeping,
    /// Asking a cluster's engine for workers.
    Placing,
    /// Forgetting old events.
    Forgetting,
}

/// A claim to a [`Duty`].
#[derive(Debug)]
pub struct DutyClaim(Option<DutyLock>);

impl Store {
    pub fn duty(&self, duty: Duty) -> DutyClaim {
        DutyClaim(match self.database() {
            // The server of a data folder is alone.
            Database::Sqlite(_) => None,
            Database::Postgres(database) => Some(database.duty_lock(duty)),
        })
    }
}

impl DutyClaim {
    /// Whether the duty is this server's at the moment. It becomes so when the server that had it ends, or can be reached by
    /// the database no more.
    ///
    /// # Errors
    /// When the database does not answer.
    #[boxed]
    pub async fn is_mine(&mut self) -> Result<bool, StoreError> {
        match &mut self.0 {
            None => Ok(true),
            Some(lock) => {
                lock.is_held().await.map_err(StoreError::database("agreeing with other servers"))
            }
        }
    }
}
