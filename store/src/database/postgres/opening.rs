//! Opening a database: the roles that may open it, and the schema that it must have.

use std::sync::LazyLock;
use std::time::Duration;

use sqlx::migrate::{Migrate, Migration, MigrationType, Migrator};
use sqlx::postgres::{PgConnectOptions, PgPoolOptions};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Executor, PgConnection, Row, SqlStr};

use super::Database;
use super::kept::{KeptConnection, is_alive};
use crate::database::patience::PATIENCE;
use crate::objects::unique_name;
use crate::place::location::DatabaseUrl;
use crate::{Access, StoreError};

/// Number, name and statements of each file in `migrations/postgres`.
const FILES: [(i64, &str, &str); 12] = [
    (1, "initial", include_str!("../../../../migrations/postgres/0001_initial.sql")),
    (2, "task_states", include_str!("../../../../migrations/postgres/0002_task_states.sql")),
    (
        3,
        "checkpoint_metrics",
        include_str!("../../../../migrations/postgres/0003_checkpoint_metrics.sql"),
    ),
    (4, "placements", include_str!("../../../../migrations/postgres/0004_placements.sql")),
    (5, "access", include_str!("../../../../migrations/postgres/0005_access.sql")),
    (6, "tracked_runs", include_str!("../../../../migrations/postgres/0006_tracked_runs.sql")),
    (7, "events", include_str!("../../../../migrations/postgres/0007_events.sql")),
    (8, "labels", include_str!("../../../../migrations/postgres/0008_labels.sql")),
    (9, "trash", include_str!("../../../../migrations/postgres/0009_trash.sql")),
    (
        11,
        "metric_extremes",
        include_str!("../../../../migrations/postgres/0011_metric_extremes.sql"),
    ),
    (
        12,
        "purged_attempts",
        include_str!("../../../../migrations/postgres/0012_purged_attempts.sql"),
    ),
    (
        13,
        "deletion_events",
        include_str!("../../../../migrations/postgres/0013_deletion_events.sql"),
    ),
];

static MIGRATIONS: LazyLock<Migrator> = LazyLock::new(|| {
    let migration = |&(version, name, sql): &(i64, &'static str, &'static str)| {
        let statements = SqlStr::from_static(sql);
        Migration::new(version, name.into(), MigrationType::Simple, statements, false)
    };
    Migrator::with_migrations(FILES.iter().map(migration).collect())
});

/// How long a request waits for a connection before the server answers 503.
const REQUEST_WAITS: Duration = Duration::from_secs(10);

/// How long an unused connection stays open. A hundred workers keep about a hundred open.
const IDLE_TIMEOUT: Duration = Duration::from_secs(30);

/// By default PostgreSQL plans a statement anew for each of its first executions on a connection.
/// Our statements find rows by index whatever their parameters are, so one plan is enough.
const PLAN_ONCE: &str = "SET plan_cache_mode = force_generic_plan";

/// Number of connections of a server, which answers many requests at once.
const SERVER_CONNECTIONS: u32 = 16;

/// Number of connections of a worker: one task and its heartbeat.
const WORKER_CONNECTIONS: u32 = 3;

pub async fn open(url: &DatabaseUrl, access: Access) -> Result<Database, StoreError> {
    let options = url.options().clone().application_name("torqued");
    let place = url.to_string();
    // The first connection reports at once what is wrong. Those of the pool wait for a database
    // that is away.
    let first = options.connect().await;
    let mut connection = first.map_err(|source| unusable(&place, &options, source))?;
    let (connections, patience) = match access {
        Access::Server => (SERVER_CONNECTIONS, REQUEST_WAITS),
        Access::Worker | Access::Transfer | Access::Rebuilding => (WORKER_CONNECTIONS, PATIENCE),
    };
    let pool = PgPoolOptions::new()
        .max_connections(connections)
        .acquire_timeout(patience)
        .idle_timeout(IDLE_TIMEOUT)
        .after_connect(|connection, _| {
            Box::pin(async { connection.execute(PLAN_ONCE).await.map(drop) })
        })
        .test_before_acquire(false)
        .before_acquire(|connection, used| {
            Box::pin(async move { Ok(is_alive(connection, used.idle_for).await) })
        })
        .connect_lazy_with(options.clone());
    let failed = |source| unusable(&place, &options, source);
    refuse_encoding(&mut connection, &place, &options).await?;
    refuse_shared_sessions(&mut connection, &place, &options).await?;
    let found = found_schema(&mut connection).await.map_err(failed)?;
    let known = known_schema();
    if found > known {
        return Err(StoreError::NewerSchema { place, found, known });
    }
    if found < known {
        match access {
            Access::Worker if found == 0 => return Err(StoreError::Absent { place }),
            Access::Worker => return Err(StoreError::OlderSchema { place, found, known }),
            // Two servers that start at once wait for each other here.
            Access::Server | Access::Transfer | Access::Rebuilding => MIGRATIONS
                .run_direct(None, &mut connection, false)
                .await
                .map_err(|source| failed_to_migrate(&place, &options, source))?,
        }
    }
    let _ = connection.close().await;
    Ok(Database { reader: pool, kept: KeptConnection::of(access), options: Box::new(options) })
}

/// The newest schema this binary knows.
pub(crate) fn known_schema() -> i64 {
    MIGRATIONS.iter().map(|migration| migration.version).max().unwrap_or(0)
}

/// The version of the database's schema; 0 before the first migration.
async fn found_schema(connection: &mut PgConnection) -> Result<i64, sqlx::Error> {
    let has_schema: bool = sqlx::query_scalar("SELECT to_regclass('_sqlx_migrations') IS NOT NULL")
        .fetch_one(&mut *connection)
        .await?;
    if !has_schema {
        return Ok(0);
    }
    let applied = connection.list_applied_migrations(&MIGRATIONS.table_name).await;
    let applied = applied.map_err(|error| sqlx::Error::Protocol(error.to_string()))?;
    Ok(applied.iter().map(|migration| migration.version).max().unwrap_or(0))
}

/// Refuses a database that cannot keep every name: one letter outside of its encoding would fail a
/// request, or the job that has it.
async fn refuse_encoding(
    connection: &mut PgConnection,
    place: &str,
    options: &PgConnectOptions,
) -> Result<(), StoreError> {
    // No prepared statement: a pooler may send it to a session that does not know it.
    let asked = sqlx::raw_sql("SELECT current_setting('server_encoding')");
    let row = asked.fetch_one(&mut *connection).await;
    let encoding: String =
        row.and_then(|row| row.try_get(0)).map_err(|source| unusable(place, options, source))?;
    if encoding == "UTF8" {
        return Ok(());
    }
    let database = options.get_database().unwrap_or_else(|| options.get_username());
    Err(StoreError::DatabaseUnusable {
        place: place.to_owned(),
        reason: format!("its encoding is {encoding}, allowed: UTF8"),
        remedy: format!(
            "create another one: createdb --encoding=UTF8 --locale=C.UTF-8 --template=template0 {database}-utf8"
        ),
    })
}

/// Refuses a connection pooler that gives one session of PostgreSQL to several clients. Workers
/// listen for tasks, and servers hold locks, for as long as their sessions last.
async fn refuse_shared_sessions(
    connection: &mut PgConnection,
    place: &str,
    options: &PgConnectOptions,
) -> Result<(), StoreError> {
    let own = unique_name("session");
    // A pooler without a free session lets the second client wait.
    let probe = tokio::time::timeout(PROBED_WITHIN, is_seen_by_others(connection, options, &own));
    match probe.await {
        Ok(Ok(true)) => {}
        Ok(Ok(false)) | Err(_) => return Ok(()),
        Ok(Err(source)) => return Err(unusable(place, options, source)),
    }
    let reason = "a connection pooler gives one session to several clients".to_owned();
    Err(StoreError::DatabaseUnusable { place: place.to_owned(), reason, remedy: POOLER.to_owned() })
}

/// Whether another client sees a setting that this one makes for its session.
async fn is_seen_by_others(
    connection: &mut PgConnection,
    options: &PgConnectOptions,
    value: &str,
) -> Result<bool, sqlx::Error> {
    let set = |value: &str| {
        let statement = format!("SELECT set_config('torqued.session', '{value}', false)");
        sqlx::raw_sql(AssertSqlSafe(statement))
    };
    set(value).execute(&mut *connection).await?;
    let mut other = options.connect().await?;
    let asked = sqlx::raw_sql("SELECT current_setting('torqued.session', true)");
    let seen: Option<String> = asked.fetch_one(&mut other).await?.try_get(0)?;
    let _ = other.close().await;
    set("").execute(&mut *connection).await?;
    Ok(seen.as_deref() == Some(value))
}

/// How long the second client may wait for its session.
const PROBED_WITHIN: Duration = Duration::from_secs(5);

const POOLER: &str = "PgBouncer needs pool_mode = session (not transaction or statement), or name \
                      PostgreSQL's own port in --database";

/// Why the database cannot be used, and what to do about it.
fn unusable(place: &str, options: &PgConnectOptions, source: sqlx::Error) -> StoreError {
    let user = options.get_username();
    let database = options.get_database().unwrap_or(user);
    // https://www.postgresql.org/docs/15/errcodes-appendix.html
    let code = source.as_database_error().and_then(|error| error.code()).unwrap_or_default();
    let remedy = match (code.as_ref(), &source) {
        ("28000" | "28P01", _) => format!("check the user {user:?} and the password in --database"),
        ("3D000", _) => format!("create it first: createdb {database}"),
        ("42501", _) => format!("allow it: GRANT CREATE ON SCHEMA public TO {user}"),
        ("53300", _) => "raise max_connections of the server, or end other programs".to_owned(),
        // A pooler sends statements of one client to different sessions.
        ("26000" | "42P05", _) => POOLER.to_owned(),
        ("08P01", _) => format!(
            "a connection pooler may refuse a parameter: PgBouncer needs ignore_startup_parameters = \
             extra_float_digits; {POOLER}"
        ),
        ("57P03", _) => "the server is starting; try again in a moment".to_owned(),
        (_, sqlx::Error::Io(_) | sqlx::Error::PoolTimedOut) => {
            "start the server, or check host and port in --database".to_owned()
        }
        (_, sqlx::Error::Tls(_)) => "check sslmode and sslrootcert in --database".to_owned(),
        _ => return StoreError::database("opening the database")(source),
    };
    let reason = match &source {
        sqlx::Error::Io(error) => error.to_string(),
        sqlx::Error::Database(error) => error.message().to_owned(),
        error => error.to_string(),
    };
    StoreError::DatabaseUnusable { place: place.to_owned(), reason, remedy }
}

fn failed_to_migrate(
    place: &str,
    options: &PgConnectOptions,
    source: sqlx::migrate::MigrateError,
) -> StoreError {
    use sqlx::migrate::MigrateError;
    match source {
        MigrateError::Execute(source) | MigrateError::ExecuteMigration(source, _) => {
            unusable(place, options, source)
        }
        source => StoreError::Migration { source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_migrations_is_run() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../migrations/postgres");
        let mut files: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        files.sort();
        let listed = FILES.map(|(version, name, _)| format!("{version:04}_{name}.sql"));
        assert_eq!(files, listed);
    }
}
