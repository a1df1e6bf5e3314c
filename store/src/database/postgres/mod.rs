//! PostgreSQL: opening, checking and migrating a database, and the SQL of its own dialect.
//!
//! Many transactions write at once, so two rules take the place of SQLite's single writer:
//!
//! - A transaction that moves jobs, or tasks between states, begins with [`Scope::Queue`] and holds
//!   one advisory lock to its end. So there is only one such transaction at a time on all machines
//!   together. A transaction with [`Scope::Task`], which only ends a task, shares that lock with
//!   others of its kind.
//! - Each other transaction locks at most the row of one task, in its first statement, and waits
//!   for nothing after it. So two transactions never wait for each other.
//!
//! A worker claims and completes most tasks in one round trip each ([`claims`]).

#[macro_use]
mod dialect;
mod claims;
mod duty;
mod events;
mod kept;
mod opening;
#[path = "../statements.rs"]
mod statements;
mod transfer;
mod waiting;

use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgArguments, PgConnectOptions};
use sqlx::query::Query;
use sqlx::{AssertSqlSafe, PgConnection, PgPool, Postgres};

use crate::database::Scope;
use crate::place::location::DatabaseUrl;
use crate::{Access, JobId, StoreError};
use kept::KeptConnection;

pub(crate) use claims::StageEnd;
pub(crate) use duty::DutyLock;
pub(crate) use events::Horizon;
pub(crate) use opening::known_schema;
pub(crate) use waiting::Bell;

/// The advisory lock of transactions that move the queue: "torqueue" in ASCII.
const QUEUE_LOCK: i64 = i64::from_be_bytes(*b"torqueue");

/// The advisory lock that transactions with [`Scope::Lease`] share: "torlease" in ASCII. Others
/// learn from it that no such transaction is open.
const LEASE_LOCK: i64 = i64::from_be_bytes(*b"torlease");

/// The first of the advisory locks of jobs: "torq" and zeros.
const TURN_LOCK: i64 = i64::from_be_bytes(*b"torq\0\0\0\0");

/// A pool of connections. Connections are opened as they are needed.
#[derive(Debug)]
pub(crate) struct Database {
    reader: PgPool,
    kept: KeptConnection,
    options: Box<PgConnectOptions>,
}

impl Database {
    pub async fn open(url: &DatabaseUrl, access: Access) -> Result<Self, StoreError> {
        opening::open(url, access).await
    }

    pub async fn begin(
        &self,
        scope: Scope,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        // Both statements are sent to the database at once.
        let begin = match scope {
            Scope::Queue => format!("BEGIN; SELECT pg_advisory_xact_lock({QUEUE_LOCK})"),
            Scope::Task => format!("BEGIN; SELECT pg_advisory_xact_lock_shared({QUEUE_LOCK})"),
            Scope::Lease => format!("BEGIN; SELECT pg_advisory_xact_lock_shared({LEASE_LOCK})"),
            Scope::Rows => "BEGIN".to_owned(),
            Scope::Statement => {
                let connection = self.lend().await.map_err(StoreError::database(operation))?;
                return Ok(self.transaction(connection, operation, false));
            }
        };
        self.begin_with(begin, operation).await
    }

    /// Begins a transaction that reads the state of one moment while others write.
    pub async fn begin_snapshot(&self, operation: &'static str) -> Result<Transaction, StoreError> {
        let begin = "BEGIN ISOLATION LEVEL REPEATABLE READ, READ ONLY; \
                     SET LOCAL idle_in_transaction_session_timeout = 0";
        self.begin_with(begin.to_owned(), operation).await
    }

    async fn begin_with(
        &self,
        begin: String,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        let connection = self.lend().await.map_err(StoreError::database(operation))?;
        // A caller that gives up from here on drops the transaction, which ends it.
        let mut transaction = self.transaction(connection, operation, true);
        let begun = sqlx::raw_sql(AssertSqlSafe(begin)).execute(transaction.connection()).await;
        begun.map_err(StoreError::database(operation))?;
        Ok(transaction)
    }

    fn transaction(
        &self,
        connection: PoolConnection<Postgres>,
        operation: &'static str,
        is_open: bool,
    ) -> Transaction {
        let (kept, pool) = (self.kept.clone(), self.reader.clone());
        Transaction { connection: Some(connection), kept, pool, operation, is_open }
    }

    /// A connection for one operation. Dropped, it goes back to the pool.
    async fn lend(&self) -> Result<PoolConnection<Postgres>, sqlx::Error> {
        self.kept.acquire(&self.reader).await
    }

    /// Takes back a connection on which nothing is under way, for the next operation.
    fn take_back(&self, connection: PoolConnection<Postgres>) {
        self.kept.keep(connection, &self.reader);
    }

    pub async fn close(&self) {
        // From here on no connection is kept.
        let closed = self.reader.close();
        self.kept.give_back();
        closed.await;
    }

    /// Returns `None`: PostgreSQL checks its own files.
    pub async fn damage(&self) -> Result<Option<String>, sqlx::Error> {
        Ok(None)
    }
}

/// An open transaction.
///
/// A dropped transaction closes its connection, so that the database rolls it back. A transaction
/// of sqlx that is dropped while it begins stays open instead: the request of a client that left at
/// that moment put its connection back into the pool with the lock of the queue, and nobody could
/// write until the connection was closed.
#[derive(Debug)]
pub(crate) struct Transaction {
    /// `None` only after the end.
    connection: Option<PoolConnection<Postgres>>,
    /// The place of the connection after the end.
    kept: KeptConnection,
    pool: PgPool,
    operation: &'static str,
    /// Whether there is something to commit. A statement of [`Scope::Statement`] is a transaction of
    /// its own.
    is_open: bool,
}

impl Drop for Transaction {
    fn drop(&mut self) {
        if self.is_open
            && let Some(connection) = &mut self.connection
        {
            connection.close_on_drop();
        }
    }
}

impl Transaction {
    /// The purpose of the transaction. It completes "while ..." in an error.
    pub const fn operation(&self) -> &'static str {
        self.operation
    }

    pub async fn commit(self) -> Result<(), StoreError> {
        self.end("COMMIT").await
    }

    pub async fn roll_back(self) -> Result<(), StoreError> {
        self.end("ROLLBACK").await
    }

    async fn end(mut self, statement: &'static str) -> Result<(), StoreError> {
        if self.is_open {
            let ended = sqlx::raw_sql(statement).execute(self.connection()).await;
            ended.map_err(StoreError::database(self.operation))?;
            self.is_open = false;
        }
        if let Some(connection) = self.connection.take() {
            self.kept.keep(connection, &self.pool);
        }
        Ok(())
    }

    /// Takes the lock of [`Scope::Queue`] without waiting. Waiting could deadlock, because others
    /// may wait for rows that this transaction has locked.
    pub async fn take_the_queue(&mut self) -> Result<bool, sqlx::Error> {
        sqlx::query_scalar("SELECT pg_try_advisory_xact_lock($1)")
            .bind(QUEUE_LOCK)
            .fetch_one(self.connection())
            .await
    }

    /// Wakes workers that wait for a task. They are woken when the transaction commits.
    pub async fn ring(&mut self) -> Result<(), sqlx::Error> {
        self.execute(sqlx::query("SELECT pg_notify($1, '')").bind(waiting::CHANNEL)).await
    }

    /// Waits until no other transaction with a turn for the same job is open, and makes later ones
    /// wait.
    pub async fn wait_for_turn(&mut self, of: JobId) -> Result<(), sqlx::Error> {
        let lock = sqlx::query("SELECT pg_advisory_xact_lock($1)").bind(TURN_LOCK ^ of.0);
        self.execute(lock).await
    }

    /// Waits until all claims that have begun are committed.
    pub async fn wait_for_claims(&mut self) -> Result<(), sqlx::Error> {
        for lock in [QUEUE_LOCK, LEASE_LOCK] {
            self.execute(sqlx::query("SELECT pg_advisory_xact_lock($1)").bind(lock)).await?;
        }
        Ok(())
    }

    /// Executes a statement that returns no rows.
    async fn execute(
        &mut self,
        statement: Query<'_, Postgres, PgArguments>,
    ) -> Result<(), sqlx::Error> {
        statement.execute(self.connection()).await?;
        Ok(())
    }

    fn connection(&mut self) -> &mut PgConnection {
        self.connection.as_mut().expect("a transaction has its connection until it ends")
    }
}
