//! SQLite: opening, checking and migrating a database, and the SQL of its own dialect.

mod claims;
mod dialect;
#[cfg(test)]
mod plans;
mod waiting;

use std::path::PathBuf;
use std::sync::LazyLock;
use std::time::Duration;

use futures::stream::{self, BoxStream, StreamExt as _, TryStreamExt as _};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, Sqlite, SqliteConnection, SqlitePool};

use crate::database::Scope;
use crate::database::query::{Query, Row, sql};
use crate::database::schema::{self, Schema};
use crate::error::sqlite_code;
use crate::place::data_dir::DataDir;
use crate::{Access, StoreError};

pub(crate) use waiting::Bell;

/// The files in `migrations/sqlite`.
pub(super) const FILES: [schema::File; 3] = [
    (16, "schema", include_str!("../../../../migrations/sqlite/0016_schema.sql")),
    (17, "robots", include_str!("../../../../migrations/sqlite/0017_robots.sql")),
    (18, "aliases", include_str!("../../../../migrations/sqlite/0018_aliases.sql")),
];

static SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let recorded = "a5b4f8949b440df79e1136df225e8bb720f009b16c06fc15bbaa9754cd813dfb\
                    40b68633c6732e95294c18504e5efb01";
    Schema::new(&FILES, recorded)
});

/// How long a process waits for another process's transaction.
const BUSY_TIMEOUT: Duration = Duration::from_secs(30);

const READERS: u32 = 4;

/// One connection that writes and a few that read. In WAL mode neither blocks the other. Writers of
/// one process queue here, in order, instead of polling SQLite's lock.
#[derive(Debug)]
pub(crate) struct Database {
    writer: SqlitePool,
    reader: SqlitePool,
    /// The file that is closed to signal queued tasks.
    bell: PathBuf,
}

impl Database {
    pub async fn open(dir: &DataDir, access: Access) -> Result<Self, StoreError> {
        let exists = dir.database().exists();
        if exists && access == Access::Worker && dir.is_read_only() {
            return Self::open_snapshot(dir).await;
        }
        if exists {
            refuse_unknown(dir, access).await?;
        } else if access == Access::Worker {
            return Err(StoreError::Absent { place: dir.place() });
        }
        let options = SqliteConnectOptions::new()
            .filename(dir.database())
            .create_if_missing(access.is_owner())
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(BUSY_TIMEOUT);
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            .acquire_timeout(BUSY_TIMEOUT)
            .before_acquire(|connection, _| Box::pin(async { Ok(is_idle(connection).await) }))
            .connect_with(options.clone())
            .await
            .map_err(|source| failed_to_open(dir, source))?;
        if access.is_owner() {
            let mut connection =
                writer.acquire().await.map_err(|source| failed_to_open(dir, source))?;
            let applied = SCHEMA.apply(&mut *connection).await;
            applied.map_err(|source| failed_to_migrate(dir, source))?;
        }
        let reader = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(BUSY_TIMEOUT)
            .connect_with(options.pragma("query_only", "ON"))
            .await
            .map_err(|source| failed_to_open(dir, source))?;
        Ok(Self { writer, reader, bell: dir.bell() })
    }

    /// Opens the database of a folder on a file system that is mounted read-only, such as a snapshot
    /// of a disk. It can only be read.
    async fn open_snapshot(dir: &DataDir) -> Result<Self, StoreError> {
        let mut log = dir.database().into_os_string();
        log.push("-wal");
        // A snapshot never changes. Without a log there is nothing to recover, and SQLite need not
        // make the files that it recovers with.
        let has_log = std::fs::metadata(&log).is_ok_and(|log| log.len() > 0);
        let options = SqliteConnectOptions::new()
            .filename(dir.database())
            .read_only(true)
            .immutable(!has_log)
            .busy_timeout(BUSY_TIMEOUT);
        refuse_schema(dir, Access::Worker, &mut connect(dir, &options).await?).await?;
        let pool = || SqlitePoolOptions::new().acquire_timeout(BUSY_TIMEOUT);
        let writer = pool().max_connections(1).connect_lazy_with(options.clone());
        let reader = pool().max_connections(READERS).connect_lazy_with(options);
        Ok(Self { writer, reader, bell: dir.bell() })
    }

    /// Begins a transaction that holds the write lock from its start, so nothing it reads can
    /// change before it writes.
    pub async fn begin(
        &self,
        scope: Scope,
        operation: &'static str,
    ) -> Result<Transaction, StoreError> {
        // All processes are on this machine. A commit that is not synced becomes durable with the
        // next one that is.
        let begun = self.writer.begin_with(match scope {
            Scope::Lease | Scope::Statement => "PRAGMA synchronous = NORMAL; BEGIN IMMEDIATE",
            Scope::Queue | Scope::Task | Scope::Rows => {
                "PRAGMA synchronous = FULL; BEGIN IMMEDIATE"
            }
        });
        let begun = begun.await;
        let inner = begun.map_err(StoreError::database(operation))?;
        Ok(Transaction { inner, operation, bell: self.bell.clone(), rings: false })
    }

    /// Begins a transaction that reads the state of one moment while others write.
    pub async fn begin_snapshot(&self, operation: &'static str) -> Result<Transaction, StoreError> {
        let begun = self.reader.begin_with("BEGIN DEFERRED").await;
        let inner = begun.map_err(StoreError::database(operation))?;
        Ok(Transaction { inner, operation, bell: self.bell.clone(), rings: false })
    }

    pub async fn fetch(
        &self,
        query: Query,
        operation: &'static str,
    ) -> Result<Vec<Row>, sqlx::Error> {
        let rows = query.for_sqlite()?.fetch_all(&self.reader).await?;
        Ok(rows.into_iter().map(|row| Row::new(row, operation)).collect())
    }

    pub async fn close(&self) {
        self.reader.close().await;
        self.writer.close().await;
    }

    /// Damage of the file, if there is any.
    pub async fn damage(&self) -> Result<Option<String>, sqlx::Error> {
        let verdict: String =
            sqlx::query_scalar("PRAGMA integrity_check(1)").fetch_one(&self.reader).await?;
        Ok(Some(verdict.replace('\n', " ")).filter(|verdict| verdict != "ok"))
    }
}

/// An open transaction, which is rolled back when it is dropped.
#[derive(Debug)]
pub(crate) struct Transaction {
    inner: sqlx::Transaction<'static, Sqlite>,
    /// The purpose of the transaction. It completes "while ..." in an error.
    pub(super) operation: &'static str,
    bell: PathBuf,
    /// Whether the transaction queued tasks.
    rings: bool,
}

impl Transaction {
    pub async fn commit(self) -> Result<(), StoreError> {
        self.inner.commit().await.map_err(StoreError::database(self.operation))?;
        if self.rings {
            waiting::ring_after_commit(&self.bell);
        }
        Ok(())
    }

    pub async fn roll_back(self) -> Result<(), StoreError> {
        self.inner.rollback().await.map_err(StoreError::database(self.operation))
    }

    /// Wakes workers that wait for a task, when the transaction commits.
    pub fn ring(&mut self) {
        self.rings = true;
    }

    pub async fn fetch(
        &mut self,
        query: Query,
        operation: &'static str,
    ) -> Result<Vec<Row>, sqlx::Error> {
        let rows = query.for_sqlite()?.fetch_all(&mut *self.inner).await?;
        Ok(rows.into_iter().map(|row| Row::new(row, operation)).collect())
    }

    pub async fn execute(&mut self, query: Query) -> Result<u64, sqlx::Error> {
        Ok(query.for_sqlite()?.execute(&mut *self.inner).await?.rows_affected())
    }

    pub fn stream(
        &mut self,
        query: Query,
        operation: &'static str,
    ) -> BoxStream<'_, Result<Row, sqlx::Error>> {
        match query.for_sqlite() {
            Ok(query) => {
                query.fetch(&mut *self.inner).map_ok(move |row| Row::new(row, operation)).boxed()
            }
            Err(error) => stream::once(async { Err(error) }).boxed(),
        }
    }
}

/// The columns of all tables. The database of a data folder has no others.
pub(super) fn columns() -> Query {
    sql("SELECT found.name, \"column\".name, \"column\".type FROM sqlite_schema AS found \
         JOIN pragma_table_info(found.name) AS \"column\" WHERE found.type = 'table' \
         AND found.name NOT LIKE 'sqlite%' AND found.name <> '_sqlx_migrations'")
}

pub(super) fn last_number(table: &str) -> Query {
    sql("SELECT seq FROM sqlite_sequence WHERE name = $1").bind(table)
}

pub(super) fn set_last_number(table: &str, last: i64) -> Vec<Query> {
    vec![
        sql("DELETE FROM sqlite_sequence WHERE name = $1").bind(table),
        sql("INSERT INTO sqlite_sequence (name, seq) VALUES ($1, $2)").bind(table).bind(last),
    ]
}

/// Whether no transaction is open on the connection. A connection with an open one is replaced;
/// otherwise nothing could be written any more.
///
/// After an error such as a full disk, SQLite may have ended a transaction that sqlx believes open,
/// or may still have one open that sqlx believes ended. Only asking both tells. SQLite says that no
/// transaction is open by refusing to roll back.
async fn is_idle(connection: &mut SqliteConnection) -> bool {
    !connection.is_in_transaction()
        && sqlx::query("ROLLBACK").execute(&mut *connection).await.is_err()
}

/// The newest schema this binary knows.
pub(crate) fn known_schema() -> i64 {
    SCHEMA.known()
}

/// Checks an existing database before anything could change it.
async fn refuse_unknown(dir: &DataDir, access: Access) -> Result<(), StoreError> {
    let options = SqliteConnectOptions::new().filename(dir.database()).busy_timeout(BUSY_TIMEOUT);
    let mut connection = connect(dir, &options).await?;
    if access.is_owner() {
        let verdict: String = sqlx::query_scalar("PRAGMA quick_check(1)")
            .fetch_one(&mut connection)
            .await
            .map_err(|source| failed_to_open(dir, source))?;
        if verdict != "ok" {
            let detail = verdict.replace('\n', " ");
            return Err(StoreError::Damaged { place: dir.place(), detail });
        }
    }
    refuse_schema(dir, access, &mut connection).await?;
    connection.close().await.map_err(|source| failed_to_open(dir, source))
}

async fn connect(
    dir: &DataDir,
    options: &SqliteConnectOptions,
) -> Result<SqliteConnection, StoreError> {
    options.connect().await.map_err(|source| failed_to_open(dir, source))
}

/// Checks that the schema is one that this program can use.
async fn refuse_schema(
    dir: &DataDir,
    access: Access,
    connection: &mut SqliteConnection,
) -> Result<(), StoreError> {
    let has_schema: bool = sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = '_sqlx_migrations')",
    )
    .fetch_one(&mut *connection)
    .await
    .map_err(|source| failed_to_open(dir, source))?;
    let found = if has_schema {
        let found = SCHEMA.found(connection).await;
        found.map_err(|source| failed_to_migrate(dir, source))?
    } else {
        0
    };
    SCHEMA.admit(found, dir.place(), access)
}

/// Result codes about the file itself (https://www.sqlite.org/rescode.html).
const SQLITE_READONLY: i32 = 8;
const SQLITE_CORRUPT: i32 = 11;
const SQLITE_CANTOPEN: i32 = 14;
const SQLITE_NOTADB: i32 = 26;

fn failed_to_open(dir: &DataDir, source: sqlx::Error) -> StoreError {
    let Some(database_error) = source.as_database_error() else {
        return StoreError::database("opening the database")(source);
    };
    let detail = database_error.message().to_owned();
    match sqlite_code(database_error) {
        Some(SQLITE_CORRUPT | SQLITE_NOTADB) => StoreError::Damaged { place: dir.place(), detail },
        Some(SQLITE_CANTOPEN | SQLITE_READONLY) => dir.unusable(std::io::Error::other(detail)),
        _ => StoreError::database("opening the database")(source),
    }
}

fn failed_to_migrate(dir: &DataDir, source: sqlx::migrate::MigrateError) -> StoreError {
    use sqlx::migrate::MigrateError;
    match source {
        MigrateError::Execute(source) | MigrateError::ExecuteMigration(source, _) => {
            failed_to_open(dir, source)
        }
        source => StoreError::Migration { source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn every_commit_is_synced_but_those_of_leases() {
        let folder = tempfile::tempdir().unwrap();
        let dir = DataDir::new(folder.path());
        let database = Database::open(&dir, Access::Server).await.unwrap();
        const NORMAL: i64 = 1;
        const FULL: i64 = 2;
        for (scope, expected) in [
            (Scope::Lease, NORMAL),
            (Scope::Rows, FULL),
            (Scope::Lease, NORMAL),
            (Scope::Task, FULL),
            (Scope::Queue, FULL),
        ] {
            let mut tx = database.begin(scope, "testing").await.unwrap();
            let synchronous: i64 =
                sqlx::query_scalar("PRAGMA synchronous").fetch_one(&mut *tx.inner).await.unwrap();
            assert_eq!(synchronous, expected, "{scope:?}");
            tx.commit().await.unwrap();
        }
    }

    #[tokio::test]
    async fn a_transaction_that_sqlite_ended_by_itself_does_not_stop_all_writing() {
        let folder = tempfile::tempdir().unwrap();
        let dir = DataDir::new(folder.path());
        let database = Database::open(&dir, Access::Server).await.unwrap();
        for _ in 0..3 {
            let mut tx = database.begin(Scope::Queue, "testing").await.unwrap();
            sqlx::query("INSERT OR ROLLBACK INTO _sqlx_migrations SELECT * FROM _sqlx_migrations")
                .execute(&mut *tx.inner)
                .await
                .unwrap_err();
            drop(tx);
        }
        database.begin(Scope::Queue, "testing").await.unwrap().commit().await.unwrap();
    }

    /// A commit that fails because the disk is full leaves the transaction open.
    #[tokio::test]
    async fn a_transaction_that_sqlite_kept_open_does_not_stop_all_writing() {
        let folder = tempfile::tempdir().unwrap();
        let dir = DataDir::new(folder.path());
        let database = Database::open(&dir, Access::Server).await.unwrap();
        let mut connection = database.writer.acquire().await.unwrap();
        sqlx::query("BEGIN IMMEDIATE").execute(&mut *connection).await.unwrap();
        drop(connection);
        database.begin(Scope::Queue, "testing").await.unwrap().commit().await.unwrap();
    }
}
