//! apalis with the roles of `store/examples/queue_rates`: `apalis_queue BATCH ROLE FOLDER
//! DATABASE ...`. BATCH is the number of tasks that a worker fetches at once.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use anyhow::{Context, bail};
use apalis::prelude::*;
use apalis_postgres::PostgresStorage;
use apalis_sqlite::SqliteStorage;
use serde_json::json;
use sqlx::postgres::PgPoolOptions;
use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{PgPool, SqlitePool};
use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::task::LocalSet;

const QUEUE: &str = "bench";

/// Connections of a worker, more than it uses at once.
const CONNECTIONS: u32 = 3;

/// Interval at which a worker polls SQLite. Its hook for new tasks sees only those of its own
/// process.
const LOOK_INTO_SQLITE_EVERY: Duration = Duration::from_millis(50);

/// Interval at which a worker polls PostgreSQL without a notification.
const LOOK_INTO_POSTGRES_EVERY: Duration = Duration::from_secs(1);

/// The same wait for another's transaction as in torqued. A worker that gives up ends.
const BUSY_TIMEOUT: Duration = Duration::from_secs(30);

/// Time from each task's submission to its execution, in microseconds.
type Waits = Arc<Mutex<Vec<u64>>>;

#[derive(Clone)]
enum Pool {
    Sqlite(SqlitePool),
    Postgres(PgPool),
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let [batch, role, folder, database, rest @ ..] = &arguments[..] else {
        bail!("usage: apalis_queue BATCH ROLE FOLDER DATABASE ...");
    };
    let batch = batch.parse()?;
    let open = || open(folder, database);
    match (*role, rest) {
        ("setup", []) => match open().await? {
            // On another connection, since this one is left with `synchronous = OFF`, which loses
            // tasks in a power cut.
            Pool::Sqlite(pool) => SqliteStorage::setup(&pool).await?,
            Pool::Postgres(pool) => PostgresStorage::setup(&pool).await?,
        },
        ("submit", ["many" | "each", count]) => push(&open().await?, count.parse()?).await?,
        ("offer", [count, period]) => {
            let pool = open().await?;
            let mut ticks = tokio::time::interval(Duration::from_millis(period.parse()?));
            for _ in 0..count.parse::<u32>()? {
                ticks.tick().await;
                push(&pool, 1).await?;
            }
        }
        ("work", [count]) => {
            let mut pools = Vec::new();
            for _ in 0..count.parse::<u32>()? {
                pools.push(open().await?);
            }
            LocalSet::new().run_until(work(pools, batch)).await?;
        }
        _ => bail!("what is {arguments:?}?"),
    }
    Ok(())
}

async fn open(folder: &str, database: &str) -> anyhow::Result<Pool> {
    if database == "sqlite" {
        let options = SqliteConnectOptions::new()
            .filename(format!("{folder}/apalis.sqlite"))
            .create_if_missing(true)
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(BUSY_TIMEOUT);
        let pool = SqlitePoolOptions::new().max_connections(CONNECTIONS).connect_with(options);
        return Ok(Pool::Sqlite(pool.await?));
    }
    let pool = PgPoolOptions::new().max_connections(CONNECTIONS).connect(database);
    Ok(Pool::Postgres(pool.await?))
}

/// Pushes `count` tasks at once. Their payload is the present time.
async fn push(pool: &Pool, count: usize) -> anyhow::Result<()> {
    let called_at = vec![now_us(); count];
    match pool {
        Pool::Sqlite(pool) => {
            let config = apalis_sqlite::Config::default().queue(QUEUE);
            SqliteStorage::<u64>::new(pool).with_config(config).push_bulk(called_at).await?;
        }
        Pool::Postgres(pool) => {
            let config = apalis_postgres::Config::default().queue(QUEUE);
            PostgresStorage::<u64>::new(pool).with_config(config).push_bulk(called_at).await?;
        }
    }
    Ok(())
}

/// Runs a worker of any backend to its end, on this thread, because its future cannot be sent to
/// another.
macro_rules! spawn_worker {
    ($backend:expr, $name:expr, $waits:expr) => {{
        let (name, waits) = ($name, Waits::clone($waits));
        let execute = move |called_at_us: u64| {
            let waited = now_us().saturating_sub(called_at_us);
            waits.lock().unwrap_or_else(PoisonError::into_inner).push(waited);
            async { Ok::<(), BoxDynError>(()) }
        };
        let worker = WorkerBuilder::new(name.clone()).backend($backend).build(execute);
        tokio::task::spawn_local(async move {
            let ended = worker.run().await;
            eprintln!("{name} ended: {ended:?}");
        });
    }};
}

/// Runs one worker on each pool, controlled by lines on standard input.
async fn work(pools: Vec<Pool>, batch: usize) -> anyhow::Result<()> {
    let waits = Waits::default();
    println!("ready");
    let mut lines = BufReader::new(tokio::io::stdin()).lines();
    while let Some(line) = lines.next_line().await? {
        match line.as_str() {
            "go" => {
                for (number, pool) in pools.iter().enumerate() {
                    begin(pool, format!("{}-{number}", std::process::id()), batch, &waits);
                }
            }
            "count" => println!("{}", acknowledged(pools.first().context("no workers")?).await?),
            other => bail!("what is {other:?}?"),
        }
    }
    let waits = waits.lock().unwrap_or_else(PoisonError::into_inner);
    println!("{}", json!({"waits_us": *waits}));
    std::process::exit(0);
}

fn begin(pool: &Pool, name: String, batch: usize, waits: &Waits) {
    match pool {
        Pool::Sqlite(pool) => {
            let config = apalis_sqlite::Config::default().queue(QUEUE).batch_size(batch);
            let backend = SqliteStorage::<u64>::new(pool).with_config(config);
            let backend = backend.poll_with_interval(LOOK_INTO_SQLITE_EVERY);
            spawn_worker!(backend, name, waits);
        }
        Pool::Postgres(pool) => {
            let config = apalis_postgres::Config::default().queue(QUEUE).batch_size(batch);
            let backend = PostgresStorage::<u64>::new(pool).with_config(config);
            let strategy = Strategy::new().interval(LOOK_INTO_POSTGRES_EVERY);
            let backend = backend.with_pubsub().poll_with_strategy(strategy);
            spawn_worker!(backend, name, waits);
        }
    }
}

/// Number of tasks that workers of this process have executed and acknowledged. Acknowledgements
/// come later, several at once.
async fn acknowledged(pool: &Pool) -> anyhow::Result<i64> {
    let own = format!("{}-%", std::process::id());
    Ok(match pool {
        Pool::Sqlite(pool) => {
            let count = "SELECT COUNT(*) FROM Jobs WHERE status = 'Done' AND lock_by LIKE ?1";
            sqlx::query_scalar(count).bind(own).fetch_one(pool).await?
        }
        Pool::Postgres(pool) => {
            let count =
                "SELECT COUNT(*) FROM apalis.jobs WHERE status = 'Done' AND lock_by LIKE $1";
            sqlx::query_scalar(count).bind(own).fetch_one(pool).await?
        }
    })
}

fn now_us() -> u64 {
    let elapsed = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default();
    u64::try_from(elapsed.as_micros()).unwrap_or(u64::MAX)
}
