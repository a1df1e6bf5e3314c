//! Opening a database: the roles that may open it, and the schema that it must have.

use std::sync::LazyLock;
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgPoolOptions};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Executor, PgConnection, Row};

use super::Database;
use super::kept::{KeptConnection, is_alive};
use crate::database::patience::PATIENCE;
use crate::database::schema::{self, Schema};
use crate::objects::unique_name;
use crate::place::location::DatabaseUrl;
use crate::{Access, StoreError};

/// The files in `migrations/postgres`.
pub(in crate::database) const FILES: [schema::File; 3] = [
    (13, "schema", include_str!("../../../../migrations/postgres/0013_schema.sql")),
    (14, "robots", include_str!("../../../../migrations/postgres/0014_robots.sql")),
    (15, "aliases", include_str!("../../../../migrations/postgres/0015_aliases.sql")),
];

static SCHEMA: LazyLock<Schema> = LazyLock::new(|| {
    let recorded = "a9e0ce8a130c4f483fd9ce1df76488b8a3f99dace0d493872c8eba99933580df\
                    849b43e2f798b67e6e6b3064a544adf1";
    Schema::new(&FILES, recorded)
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
    SCHEMA.admit(found, place.clone(), access)?;
    // Only an owner gets this far with an older schema. Two servers that start at once wait for each
    // other here.
    if found < known_schema() {
        let applied = SCHEMA.apply(&mut connection).await;
        applied.map_err(|source| failed_to_migrate(&place, &options, source))?;
    }
    let _ = connection.close().await;
    Ok(Database { reader: pool, kept: KeptConnection::of(access), options: Box::new(options) })
}

/// The newest schema this binary knows.
pub(crate) fn known_schema() -> i64 {
    SCHEMA.known()
}

/// The version of the database's schema; 0 before the first migration.
async fn found_schema(connection: &mut PgConnection) -> Result<i64, sqlx::Error> {
    let has_schema: bool = sqlx::query_scalar("SELECT to_regclass('_sqlx_migrations') IS NOT NULL")
        .fetch_one(&mut *connection)
        .await?;
    if !has_schema {
        return Ok(0);
    }
    let found = SCHEMA.found(connection).await;
    found.map_err(|error| sqlx::Error::Protocol(error.to_string()))
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
