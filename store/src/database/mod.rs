//! The seam between the store and its databases. The functions of `statements` are everything that
//! the store asks of a database. They are compiled for each database, and [`sql`] calls one of
//! them.
//!
//! The databases are SQLite, in the data folder, and PostgreSQL, which servers and workers of many
//! machines may share. Each has a `dialect` for its differences, and says how
//! it is opened, how a transaction begins and how workers wait for a task. Claims are written
//! twice: SQLite reads the next task and leases it in one transaction, and PostgreSQL does both,
//! and most completions, in one round trip. One suite (`tests/suite`) checks both databases.
//!
//! The authors of a third database should know:
//!
//! - SQLite lets one transaction write at a time, so what a transaction has read is still true when
//!   it writes. In PostgreSQL a transaction declares what it may change (`Scope`).
//! - SQLite syncs every commit except those of leases and reports of presence. A power cut that
//!   loses them also ends all workers of the machine.
//! - Moments are those of the database's clock, never a time from Rust.
//! - States, contents of files and digests are text. JSON is text too, kept as it was written.
//! - A transaction that queues tasks rings: PostgreSQL notifies, and with SQLite a file is closed
//!   that workers watch. A worker that hears nothing looks once a second.
//! - Workers wait for a database that goes away. For up to 10 minutes they try writes of results
//!   again, and reads wait for a connection. A server answers 503 meanwhile.
//! - Steps that a database cannot do alone are done before it: objects are published before a
//!   transaction begins.

pub(crate) mod columns;
pub(crate) mod patience;
pub(crate) mod postgres;
pub(crate) mod sqlite;

use crate::place::data_dir::DataDir;
use crate::place::location::DatabaseUrl;
use crate::{Access, Store, StoreError};

/// An open database.
#[derive(Debug)]
pub(crate) enum Database {
    Sqlite(sqlite::Database),
    Postgres(postgres::Database),
}

/// Statements that take effect together. Rows that the transaction has read and its [`Scope`]
/// covers do not change until it ends.
pub(crate) enum Transaction {
    Sqlite(sqlite::Transaction),
    Postgres(postgres::Transaction),
}

/// The rows that a transaction may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scope {
    /// The states of jobs and tasks: one such transaction at a time.
    Queue,
    /// The end of one leased task that leaves its job as it is. Many at a time, but none beside one
    /// of `Queue`.
    Task,
    /// Rows of one leased task, whose own row it locks first. Or rows that belong to no task.
    Rows,
    /// Like `Rows`, for rows that mean nothing without the process that wrote them: a lease or a
    /// heartbeat. A power cut that ends the database and all such processes may lose them.
    Lease,
    /// Like `Lease`, for one statement that locks nothing.
    Statement,
}

/// Calls a statement: `sql!(database, "reading jobs", jobs(filter))` or `sql!(transaction,
/// end_job(job))`. The operation completes "while ..." in an error.
macro_rules! sql {
    ($database:expr, $operation:expr, $statement:ident($($argument:expr),* $(,)?)) => {
        match $database {
            $crate::database::Database::Sqlite(database) => {
                database.$statement($($argument),*).await
            }
            $crate::database::Database::Postgres(database) => {
                database.$statement($($argument),*).await
            }
        }
        .map_err($crate::StoreError::database($operation))
    };
    ($transaction:expr, $statement:ident($($argument:expr),* $(,)?)) => {
        match $transaction {
            $crate::database::Transaction::Sqlite(transaction) => {
                let operation = transaction.operation();
                let answer = transaction.$statement($($argument),*).await;
                answer.map_err($crate::StoreError::database(operation))
            }
            $crate::database::Transaction::Postgres(transaction) => {
                let operation = transaction.operation();
                let answer = transaction.$statement($($argument),*).await;
                answer.map_err($crate::StoreError::database(operation))
            }
        }
    };
}
pub(crate) use sql;

impl Database {
    /// Opens the database at `url`, or the one in the data folder.
    pub async fn open(
        dir: &DataDir,
        url: Option<&DatabaseUrl>,
        access: Access,
    ) -> Result<Self, StoreError> {
        match url {
            Some(url) => postgres::Database::open(url, access).await.map(Self::Postgres),
            None => sqlite::Database::open(dir, access).await.map(Self::Sqlite),
        }
    }

    /// The newest schema that this binary knows.
    pub fn known_schema(&self) -> i64 {
        match self {
            Self::Sqlite(_) => sqlite::known_schema(),
            Self::Postgres(_) => postgres::known_schema(),
        }
    }

    pub async fn close(&self) {
        match self {
            Self::Sqlite(database) => database.close().await,
            Self::Postgres(database) => database.close().await,
        }
    }
}

impl Transaction {
    pub async fn commit(self) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(transaction) => transaction.commit().await,
            Self::Postgres(transaction) => transaction.commit().await,
        }
    }

    /// Rolls the transaction back now. A dropped transaction is rolled back too, but a moment
    /// later.
    pub async fn roll_back(self) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(transaction) => transaction.roll_back().await,
            Self::Postgres(transaction) => transaction.roll_back().await,
        }
    }

    /// Widens its scope to [`Scope::Queue`] if that is possible at once, because no other
    /// transaction moves the queue or ends a task. If it returns false, roll this transaction back
    /// and begin another one, which waits.
    pub async fn take_the_queue(&mut self) -> Result<bool, StoreError> {
        match self {
            // Nobody else writes meanwhile.
            Self::Sqlite(_) => Ok(true),
            Self::Postgres(transaction) => {
                let operation = transaction.operation();
                transaction.take_the_queue().await.map_err(StoreError::database(operation))
            }
        }
    }
}

impl Store {
    /// Begins a transaction that reads the state of one moment while others write.
    pub(crate) async fn begin_snapshot(
        &self,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        match self.database() {
            Database::Sqlite(database) => {
                database.begin_snapshot(operation).await.map(Transaction::Sqlite)
            }
            Database::Postgres(database) => {
                database.begin_snapshot(operation).await.map(Transaction::Postgres)
            }
        }
    }

    pub(crate) async fn begin(
        &self,
        scope: Scope,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        match self.database() {
            Database::Sqlite(database) => {
                database.begin(scope, operation).await.map(Transaction::Sqlite)
            }
            Database::Postgres(database) => {
                database.begin(scope, operation).await.map(Transaction::Postgres)
            }
        }
    }
}
