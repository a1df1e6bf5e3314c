//! Duties that one server has for all servers that share a store. Two servers may use one
//! PostgreSQL, and only one of them does the housekeeping.

use crate::boxed;
use crate::database::Duty;
use crate::database::postgres::DutyLock;
use crate::{Store, StoreError};

/// A claim to a [`Duty`].
#[derive(Debug)]
pub struct DutyClaim(Option<DutyLock>);

impl Store {
    /// A claim to a duty of servers. Nobody has taken it yet.
    pub fn duty(&self, duty: Duty) -> DutyClaim {
        DutyClaim(self.database().duty_lock(duty))
    }
}

impl DutyClaim {
    /// Whether the duty is this server's at the moment. A server gets it when the server that had
    /// it ends, or when the database can no longer reach that server.
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
