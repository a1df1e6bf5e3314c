//! The seam between the store and its databases. What the store asks of a database are the functions
//! of the folder `sqlite`; [`sql`] calls one of them.

use crate::data_dir::DataDir;
use crate::{Access, Store, StoreError, sqlite};

/// A database, open.
#[derive(Debug)]
pub(crate) enum Database {
    Sqlite(sqlite::Database),
}

/// Statements that take effect together. What a transaction has read stays so until it ends.
pub(crate) enum Transaction {
    Sqlite(sqlite::Transaction),
}

/// Calls a statement: `sql!(database, "reading jobs", jobs(filter))`, whose operation completes
/// "while ..." in an error, or `sql!(transaction, end_job(job))`.
macro_rules! sql {
    ($database:expr, $operation:expr, $statement:ident($($argument:expr),* $(,)?)) => {
        match $database {
            $crate::database::Database::Sqlite(database) => {
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
        }
    };
}
pub(crate) use sql;

impl Database {
    pub async fn open(dir: &DataDir, access: Access) -> Result<Self, StoreError> {
        sqlite::Database::open(dir, access).await.map(Self::Sqlite)
    }

    /// The newest schema that this binary knows.
    pub fn known_schema(&self) -> i64 {
        match self {
            Self::Sqlite(_) => sqlite::known_schema(),
        }
    }

    pub async fn close(&self) {
        match self {
            Self::Sqlite(database) => database.close().await,
        }
    }
}

impl Transaction {
    pub async fn commit(self) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(transaction) => transaction.commit().await,
        }
    }
}

impl Store {
    pub(crate) async fn begin(&self, operation: &'static str) -> Result<Transaction, StoreError> {
        match self.database() {
            Database::Sqlite(database) => database.begin(operation).await.map(Transaction::Sqlite),
        }
    }
}
