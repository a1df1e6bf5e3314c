//! Locks that decide which of the servers that share a database has a duty.

use std::time::Duration;

use sqlx::postgres::PgConnectOptions;
use sqlx::{ConnectOptions, PgConnection};

use super::Database;
use crate::database::Duty;

/// Time limit for an answer of a connection that holds a lock.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);

/// An advisory lock on its own connection. It lasts as long as the connection.
#[derive(Debug)]
pub(crate) struct DutyLock {
    options: Box<PgConnectOptions>,
    duty: Duty,
    held: Option<PgConnection>,
}

impl Database {
    pub fn duty_lock(&self, duty: Duty) -> DutyLock {
        DutyLock { options: self.options.clone(), duty, held: None }
    }
}

impl DutyLock {
    /// Whether this lock is held. Takes it if nobody else has it.
    pub async fn is_held(&mut self) -> Result<bool, sqlx::Error> {
        if let Some(connection) = &mut self.held {
            let answer = sqlx::query("SELECT 1").execute(connection);
            if matches!(tokio::time::timeout(ANSWER_WITHIN, answer).await, Ok(Ok(_))) {
                return Ok(true);
            }
            self.held = None;
        }
        let mut connection = self.options.connect().await?;
        let taken: bool = sqlx::query_scalar("SELECT pg_try_advisory_lock($1)")
            .bind(key(self.duty))
            .fetch_one(&mut connection)
            .await?;
        self.held = taken.then_some(connection);
        Ok(taken)
    }
}

const fn key(duty: Duty) -> i64 {
    i64::from_be_bytes(match duty {
        Duty::Reaping => *b"torqreap",
        Duty::Sweeping => *b"torqswep",
        Duty::Placing => *b"torqplac",
        Duty::Forgetting => *b"torqforg",
    })
}
