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

mod claims;
mod dialect;
mod duty;
mod events;
mod kept;
mod opening;
mod waiting;

use futures::stream::{self, BoxStream, StreamExt as _, TryStreamExt as _};
use sqlx::pool::PoolConnection;
use sqlx::postgres::PgConnectOptions;
use sqlx::{AssertSqlSafe, PgConnection, PgPool, Postgres};

use crate::database::Scope;
use crate::database::column::json;
use crate::database::query::{Query, Row, sql};
use crate::place::location::DatabaseUrl;
use crate::{Access, JobId, StoreError};
use kept::KeptConnection;

pub(crate) use duty::DutyLock;
pub(crate) use events::Horizon;
#[cfg(test)]
pub(super) use opening::FILES;
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

    pub async fn fetch(
        &self,
        query: Query,
        operation: &'static str,
    ) -> Result<Vec<Row>, sqlx::Error> {
        let mut connection = self.lend().await?;
        let rows = query.for_postgres()?.fetch_all(&mut *connection).await?;
        self.take_back(connection);
        Ok(rows.into_iter().map(|row| Row::new(row, operation)).collect())
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
    /// The purpose of the transaction. It completes "while ..." in an error.
    pub(super) operation: &'static str,
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

    pub async fn fetch(
        &mut self,
        query: Query,
        operation: &'static str,
    ) -> Result<Vec<Row>, sqlx::Error> {
        let rows = query.for_postgres()?.fetch_all(self.connection()).await?;
        Ok(rows.into_iter().map(|row| Row::new(row, operation)).collect())
    }

    pub async fn execute(&mut self, query: Query) -> Result<u64, sqlx::Error> {
        Ok(query.for_postgres()?.execute(self.connection()).await?.rows_affected())
    }

    pub fn stream(
        &mut self,
        query: Query,
        operation: &'static str,
    ) -> BoxStream<'_, Result<Row, sqlx::Error>> {
        match query.for_postgres() {
            Ok(query) => {
                query.fetch(self.connection()).map_ok(move |row| Row::new(row, operation)).boxed()
            }
            Err(error) => stream::once(async { Err(error) }).boxed(),
        }
    }

    fn connection(&mut self) -> &mut PgConnection {
        self.connection.as_mut().expect("a transaction has its connection until it ends")
    }
}

/// Notifies workers that wait for a task, when the transaction commits.
pub(super) fn ring() -> Query {
    sql("SELECT pg_notify($1, '')").bind(waiting::CHANNEL)
}

/// Takes the lock of [`Scope::Queue`] without waiting. Waiting could deadlock, because others may
/// wait for rows that this transaction has locked.
pub(super) fn take_the_queue() -> Query {
    sql("SELECT pg_try_advisory_xact_lock($1)").bind(QUEUE_LOCK)
}

pub(super) fn turn_of(job: JobId) -> Query {
    sql("SELECT pg_advisory_xact_lock($1)").bind(TURN_LOCK ^ job.0)
}

pub(super) fn locks_of_claims() -> [Query; 2] {
    [QUEUE_LOCK, LEASE_LOCK].map(|lock| sql("SELECT pg_advisory_xact_lock($1)").bind(lock))
}

pub(super) fn locks_of_tables(tables: &[&str]) -> [Query; 2] {
    let lock = format!("LOCK TABLE {} IN SHARE MODE", tables.join(", "));
    [sql("SET LOCAL idle_in_transaction_session_timeout = 0"), sql(lock)]
}

/// The columns of these tables. The database may have other tables, which are not ours.
pub(super) fn columns(tables: &[&str]) -> Query {
    sql("SELECT CAST(table_name AS TEXT), CAST(column_name AS TEXT), CAST(data_type AS TEXT) \
         FROM information_schema.columns WHERE table_schema = current_schema() \
         AND table_name IN {texts $1}")
    .bind(json(tables))
}

pub(super) fn last_number(table: &str) -> Query {
    sql("SELECT pg_sequence_last_value(CAST(pg_get_serial_sequence($1, 'id') AS regclass))")
        .bind(table)
}

/// A sequence begins at 1. Before its first use there is nothing to do.
pub(super) fn set_last_number(table: &str, last: i64) -> Vec<Query> {
    let set = sql("SELECT setval(CAST(pg_get_serial_sequence($1, 'id') AS regclass), $2)");
    if last < 1 { Vec::new() } else { vec![set.bind(table).bind(last)] }
}
