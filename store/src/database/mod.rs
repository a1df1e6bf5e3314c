//! The contract of a database: everything that SQLite and PostgreSQL do differently is on this page.
//!
//! All other statements are written once, in the files `statements` beside the operations that use
//! them, as values of [`query::Query`]. A third database is a module beside [`sqlite`] and
//! [`postgres`], with its own arm in each function of this page, and the fragments of SQL below.
//!
//! Claims are written twice: SQLite reads the next task and leases it in one transaction, and
//! PostgreSQL does both, and most completions, in one round trip. One suite (`tests/suite`) checks
//! both databases.
//!
//! The authors of a third database should know:
//!
//! - SQLite lets one transaction write at a time, so what a transaction has read is still true when
//!   it writes. In PostgreSQL a transaction declares what it may change (`Scope`).
//! - SQLite syncs every commit except those of leases and reports of presence. A power cut that
//!   loses them also ends all workers of the machine.
//! - Moments are those of the database's clock, never a time from Rust.
//! - JSON is text, kept as it was written.
//! - A transaction that queues tasks rings: PostgreSQL notifies, and with SQLite a file is closed
//!   that workers watch. A worker that hears nothing looks once a second.
//! - Workers wait for a database that goes away. For up to 10 minutes they try writes of results
//!   again, and reads wait for a connection. A server answers 503 meanwhile.
//! - Steps that a database cannot do alone are done before it: objects are published before a
//!   transaction begins.
//!
//! # Fragments of SQL
//!
//! A statement has these in braces. Each database replaces them (`fragment` in its `dialect`).
//!
//! | fragment | meaning |
//! |---|---|
//! | `now` | the time by the database's clock, in milliseconds since 1970; advances in a transaction |
//! | `ids $1` | the ids of a parameter that is a JSON list of ids, for `IN` |
//! | `texts $1` | the texts of a parameter that is a JSON list of texts, for `IN` |
//! | `items $1` | the lists of a parameter that is a JSON list of lists, as rows `item` in the order `item.key` |
//! | `integer 0`, `text 0` | an element of an `item` |
//! | `field column $1` | a field of a column of JSON, as text; `NULL` if there is none |
//! | `number column step step` | the number at a path of names and indexes in a column of JSON; `NULL` if there is none |
//! | `tags table item id` | the tags of an item, from a table of tags, as JSON |
//! | `unique` | 32 hexadecimal digits that are unique |
//! | `chance` | a random integer from 0 to 250 |
//! | `larger` | the function that returns the larger of two numbers |
//! | `find` | the function that returns the position of a text in another from 1; 0 if it is not there |
//! | `by_bytes` | after a text: comparisons go by bytes |
//! | `is_experiment` | the condition of the partial indexes of experiments, word for word |
//! | `locked` | after a query: locks the rows until the transaction ends |
//! | `both`, `and`, `end` | around two statements that change rows of different tables in one round trip |
//! | `first_in_line` | the first task in line that a worker `$1` could take that offers `$2` to `$5` |
//! | `gone job` | whether a job or one of its results was deleted; the same in all databases |
//!
//! # Rules of portable SQL
//!
//! Parameters are numbered (`$1`). Integers have 64 bits and a sign. Booleans are not compared with
//! anything (`WHERE NOT is_part`). Sums are cast to `BIGINT`. A column beside an aggregate is always
//! grouped by. States, JSON and digests are text.

pub(crate) mod column;
pub(crate) mod patience;
pub(crate) mod postgres;
pub(crate) mod query;
pub(crate) mod rows;
mod schema;
pub(crate) mod sqlite;

use std::time::Duration;

use futures::stream::{BoxStream, StreamExt as _};
use serde_json::Value;
use spec::Resources;

use self::query::{Executor, Query, Row, Writer};
use crate::place::data_dir::DataDir;
use crate::place::location::DatabaseUrl;
use crate::queue::statements::tasks::NextTask;
use crate::{Access, Fence, JobId, StoreError};

/// An open database.
#[derive(Debug)]
pub(crate) enum Database {
    Sqlite(sqlite::Database),
    Postgres(postgres::Database),
}

/// Statements that take effect together. Rows that the transaction has read and its [`Scope`]
/// covers do not change until it ends.
#[derive(Debug)]
pub(crate) enum Transaction {
    Sqlite(sqlite::Transaction),
    Postgres(postgres::Transaction),
}

/// Reads from a database outside of a transaction.
#[derive(Debug)]
pub(crate) struct Reading<'a> {
    database: &'a Database,
    operation: &'static str,
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

/// A claimed task as it was before the claim.
#[derive(Debug)]
pub(crate) struct Claim {
    pub next: NextTask,
    /// The transaction that the caller commits; `None` if the claim is committed.
    pub open: Option<Transaction>,
}

/// Work that only one server does at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Duty {
    /// Giving the tasks of dead workers to other workers.
    Reaping,
    /// Deleting objects without a row.
    Sweeping,
    /// Asking Slurm or Kubernetes for workers.
    Placing,
    /// Deleting old events.
    Forgetting,
}

/// A column, as a database describes it.
#[derive(Clone, Debug)]
pub(crate) struct FoundColumn {
    pub table: String,
    pub name: String,
    pub type_name: String,
}

/// The outcome of [`Database::complete_in_stage`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StageEnd {
    /// It is completed, and its job stays as it is: another task of its stage is queued.
    Completed,
    /// Nothing was changed: the job may have to move on with it, or a transaction must find out.
    Last,
    /// Nothing was changed: the lease is lost.
    Lost,
}

/// How far events have settled. Each look updates it.
#[derive(Debug, Default)]
pub(crate) struct Horizon(postgres::Horizon);

/// Hears that tasks were queued.
#[derive(Debug)]
pub(crate) enum Ringing {
    Sqlite(sqlite::Bell),
    Postgres(postgres::Bell),
}

impl Database {
    /// Opens the database at `url`, or the one in the data folder. Creates it, or brings its schema
    /// up to date, for an owner.
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

    /// Closes all connections.
    pub async fn close(&self) {
        match self {
            Self::Sqlite(database) => database.close().await,
            Self::Postgres(database) => database.close().await,
        }
    }

    /// Damage of the file, if there is any. PostgreSQL checks its own files.
    pub async fn damage(&self) -> Result<Option<String>, sqlx::Error> {
        match self {
            Self::Sqlite(database) => database.damage().await,
            Self::Postgres(_) => Ok(None),
        }
    }

    /// Reads outside of a transaction.
    pub fn read(&self, operation: &'static str) -> Reading<'_> {
        Reading { database: self, operation }
    }

    /// Begins a transaction. In SQLite all scopes hold the one write lock, and only commits of
    /// `Lease` and `Statement` are not synced. In PostgreSQL a scope is a lock, or none.
    pub async fn begin(
        &self,
        scope: Scope,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        match self {
            Self::Sqlite(database) => {
                database.begin(scope, operation).await.map(Transaction::Sqlite)
            }
            Self::Postgres(database) => {
                database.begin(scope, operation).await.map(Transaction::Postgres)
            }
        }
    }

    /// Begins a transaction that reads the state of one moment while others write.
    pub async fn begin_snapshot(&self, operation: &'static str) -> Result<Transaction, StoreError> {
        match self {
            Self::Sqlite(database) => {
                database.begin_snapshot(operation).await.map(Transaction::Sqlite)
            }
            Self::Postgres(database) => {
                database.begin_snapshot(operation).await.map(Transaction::Postgres)
            }
        }
    }

    /// Leases the next task in line to `worker` for `ttl`. SQLite reads and leases it in an open
    /// transaction. PostgreSQL does both in one round trip, and passes over tasks that others are
    /// claiming.
    pub async fn claim(
        &self,
        worker: &str,
        offers: &Resources,
        ttl: Duration,
        operation: &'static str,
    ) -> Result<Option<Claim>, StoreError> {
        match self {
            Self::Sqlite(_) => {
                let mut tx = self.begin(Scope::Lease, operation).await?;
                let next = tx.claim_next(worker, offers, ttl).await?;
                Ok(next.map(|next| Claim { next, open: Some(tx) }))
            }
            Self::Postgres(database) => {
                let next = database.claim(worker, offers, ttl, operation).await?;
                Ok(next.map(|next| Claim { next, open: None }))
            }
        }
    }

    /// Completes a held task, and its attempt, if another task of its stage is queued. PostgreSQL
    /// does it in one round trip. SQLite has no round trips to save.
    pub async fn complete_in_stage(
        &self,
        fence: Fence,
        result: Option<&Value>,
        operation: &'static str,
    ) -> Result<StageEnd, StoreError> {
        match self {
            Self::Sqlite(_) => Ok(StageEnd::Last),
            Self::Postgres(database) => {
                let ended = database.complete_in_stage(fence, result).await;
                ended.map_err(StoreError::database(operation))
            }
        }
    }

    /// The id up to which all events can be read, so none will appear later. `None` as long as it
    /// is not known. In PostgreSQL transactions do not commit in the order of their events' ids.
    pub async fn settled_event(&self, horizon: &mut Horizon) -> Result<Option<i64>, StoreError> {
        const OPERATION: &str = "looking for events";
        match self {
            Self::Sqlite(_) => {
                let mut reading = self.read(OPERATION);
                query::sql("SELECT MAX(id) FROM event").one(&mut reading).await
            }
            Self::Postgres(database) => {
                let settled = database.settled_event(&mut horizon.0).await;
                settled.map_err(StoreError::database(OPERATION))
            }
        }
    }

    /// Hears of tasks that are queued from now on: SQLite's processes watch a file, PostgreSQL's
    /// listen on a connection.
    pub async fn bell(&self) -> Result<Ringing, StoreError> {
        match self {
            Self::Sqlite(database) => Ok(Ringing::Sqlite(database.bell())),
            Self::Postgres(database) => {
                let bell = database.bell().await.map(Ringing::Postgres);
                bell.map_err(StoreError::database("listening for tasks"))
            }
        }
    }

    /// A lock that one server has for a duty; `None` if no other server can use the database.
    pub fn duty_lock(&self, duty: Duty) -> Option<postgres::DutyLock> {
        match self {
            Self::Sqlite(_) => None,
            Self::Postgres(database) => Some(database.duty_lock(duty)),
        }
    }
}

impl Ringing {
    /// Waits until tasks may have been queued, or for `longest`. Returns which of the two happened.
    pub async fn wait(&mut self, longest: Duration) -> Result<bool, StoreError> {
        match self {
            Self::Sqlite(bell) => Ok(bell.wait(longest).await),
            Self::Postgres(bell) => {
                bell.wait(longest).await.map_err(StoreError::database("waiting for a task"))
            }
        }
    }
}

impl Transaction {
    /// Makes the changes last, and rings if tasks were queued.
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

    /// The rows of a large table, one after the other.
    pub fn stream(&mut self, query: Query) -> BoxStream<'_, Result<Row, StoreError>> {
        let operation = self.operation();
        let rows = match self {
            Self::Sqlite(transaction) => transaction.stream(query, operation),
            Self::Postgres(transaction) => transaction.stream(query, operation),
        };
        rows.map(move |row| row.map_err(StoreError::database(operation))).boxed()
    }

    /// Wakes workers that wait for a task, when the transaction commits.
    pub async fn ring(&mut self) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(transaction) => {
                transaction.ring();
                Ok(())
            }
            Self::Postgres(_) => postgres::ring().run(self).await,
        }
    }

    /// Widens its scope to [`Scope::Queue`] if that is possible at once, because no other
    /// transaction moves the queue or ends a task. If it returns false, roll this transaction back
    /// and begin another one, which waits.
    pub async fn take_the_queue(&mut self) -> Result<bool, StoreError> {
        match self {
            // Nobody else writes meanwhile.
            Self::Sqlite(_) => Ok(true),
            Self::Postgres(_) => postgres::take_the_queue().one(self).await,
        }
    }

    /// Waits until no other transaction with a turn for the same job is open, and makes later ones
    /// wait. In SQLite nobody else writes meanwhile.
    pub async fn wait_for_turn(&mut self, of: JobId) -> Result<(), StoreError> {
        match self {
            Self::Sqlite(_) => Ok(()),
            Self::Postgres(_) => postgres::turn_of(of).run(self).await,
        }
    }

    /// Waits until all claims that have begun are committed. In SQLite nobody claims meanwhile.
    pub async fn wait_for_claims(&mut self) -> Result<(), StoreError> {
        if let Self::Postgres(_) = self {
            for lock in postgres::locks_of_claims() {
                lock.run(self).await?;
            }
        }
        Ok(())
    }

    /// Locks the tables against all other writers until the transaction ends. SQLite's transaction
    /// holds the only write lock already.
    pub async fn keep_still(&mut self, tables: &[&str]) -> Result<(), StoreError> {
        if let Self::Postgres(_) = self {
            for lock in postgres::locks_of_tables(tables) {
                lock.run(self).await?;
            }
        }
        Ok(())
    }

    /// The columns of these tables. SQLite returns all tables, because its file has no others.
    pub async fn columns(&mut self, tables: &[&str]) -> Result<Vec<FoundColumn>, StoreError> {
        let columns = match self {
            Self::Sqlite(_) => sqlite::columns(),
            Self::Postgres(_) => postgres::columns(tables),
        };
        let found: Vec<(String, String, String)> = columns.all(self).await?;
        let column = |(table, name, type_name)| FoundColumn { table, name, type_name };
        Ok(found.into_iter().map(column).collect())
    }

    /// The largest id that a table has assigned so far; `None` for a table without assigned ids.
    pub async fn last_number(&mut self, table: &str) -> Result<Option<i64>, StoreError> {
        let last: Option<Option<i64>> = match self {
            Self::Sqlite(_) => sqlite::last_number(table).optional(self).await?,
            Self::Postgres(_) => postgres::last_number(table).optional(self).await?,
        };
        Ok(last.flatten())
    }

    /// Makes the next id of the table larger than `last`.
    pub async fn set_last_number(&mut self, table: &str, last: i64) -> Result<(), StoreError> {
        let statements = match self {
            Self::Sqlite(_) => sqlite::set_last_number(table, last),
            Self::Postgres(_) => postgres::set_last_number(table, last),
        };
        for statement in statements {
            statement.rows(self).await?;
        }
        Ok(())
    }
}

impl Executor for Transaction {
    fn operation(&self) -> &'static str {
        match self {
            Self::Sqlite(transaction) => transaction.operation,
            Self::Postgres(transaction) => transaction.operation,
        }
    }

    async fn fetch(&mut self, query: Query) -> Result<Vec<Row>, StoreError> {
        let operation = self.operation();
        let rows = match self {
            Self::Sqlite(transaction) => transaction.fetch(query, operation).await,
            Self::Postgres(transaction) => transaction.fetch(query, operation).await,
        };
        rows.map_err(StoreError::database(operation))
    }
}

impl Writer for Transaction {
    async fn execute(&mut self, query: Query) -> Result<u64, StoreError> {
        let operation = self.operation();
        let changed = match self {
            Self::Sqlite(transaction) => transaction.execute(query).await,
            Self::Postgres(transaction) => transaction.execute(query).await,
        };
        changed.map_err(StoreError::database(operation))
    }
}

impl Executor for Reading<'_> {
    fn operation(&self) -> &'static str {
        self.operation
    }

    async fn fetch(&mut self, query: Query) -> Result<Vec<Row>, StoreError> {
        let rows = match self.database {
            Database::Sqlite(database) => database.fetch(query, self.operation).await,
            Database::Postgres(database) => database.fetch(query, self.operation).await,
        };
        rows.map_err(StoreError::database(self.operation))
    }
}
