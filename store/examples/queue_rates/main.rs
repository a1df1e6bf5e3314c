//! The queue for `cargo xtask bench queue`: a program that submits, and processes of workers.
//!
//! `queue_rates ROLE FOLDER DATABASE ...`, where DATABASE is `sqlite`, in the folder, or a URL of
//! PostgreSQL:
//!
//! - `cluster` (without other arguments) starts its own PostgreSQL. For each name that it reads it
//!   creates a database, and prints its URL and the server's process. It ends with its input.
//! - `setup` creates the tables.
//! - `submit many N` submits a job of N tasks, and `submit each N` submits N jobs of one task.
//! - `offer N PERIOD_MS` submits N jobs of one task, one every PERIOD_MS.
//! - `metrics N` prints how many values of metrics N trainings record per second.
//! - `runs N POINTS` makes N runs of trainings, the last one with a metric of POINTS points, and
//!   prints the last one's id.
//! - `work N` is a process of N workers, each with its own connections. See `working.rs` for its
//!   input and output.
//!
//! Programs that measure other queues have the same roles, except `cluster`, `metrics` and `runs`.

mod recording;
mod submitting;
mod working;

use std::io::BufRead;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use serde_json::json;
use store::{Access, Location, Store};
use testbed::{Cluster, Durability};

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    if arguments == ["cluster"] {
        return cluster();
    }
    let [role, folder, database, rest @ ..] = &arguments[..] else {
        return Err("usage: queue_rates ROLE FOLDER DATABASE ...".into());
    };
    let place = location(folder, database)?;
    tokio::runtime::Runtime::new()?.block_on(async {
        match (*role, rest) {
            ("setup", []) => {
                let store = Store::open_at(&place, Access::Server).await?;
                store.register_server(working::VERSION).await?;
                store.close().await;
                Ok(())
            }
            ("submit", ["many", count]) => submitting::one_job(&place, count.parse()?).await,
            ("submit", ["each", count]) => submitting::many_jobs(&place, count.parse()?).await,
            ("offer", [count, period]) => {
                let period = Duration::from_millis(period.parse()?);
                submitting::every_so_often(&place, count.parse()?, period).await
            }
            ("metrics", [trainings]) => recording::run(&place, trainings.parse()?).await,
            ("runs", [count, points]) => {
                recording::runs(&place, count.parse()?, points.parse()?).await
            }
            ("work", [count]) => working::run(&place, count.parse()?).await,
            _ => Err(format!("what is {arguments:?}?").into()),
        }
    })
}

fn location(folder: &str, database: &str) -> Outcome<Location> {
    let url = match database {
        "sqlite" => None,
        url => Some(url.parse()?),
    };
    Ok(Location { database: url, ..Location::in_folder(Path::new(folder)) })
}

fn cluster() -> Outcome<()> {
    let cluster = Arc::new(Cluster::start(Durability::Full));
    for name in std::io::stdin().lock().lines() {
        let name = name?;
        cluster.psql("postgres", &format!("CREATE DATABASE {name}"));
        println!("{}", json!({"url": cluster.url("postgres", &name), "server": cluster.process()}));
    }
    Ok(())
}

/// The present in microseconds since 1970. All processes of a machine agree on it.
fn now_us() -> u64 {
    let elapsed = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default();
    u64::try_from(elapsed.as_micros()).unwrap_or(u64::MAX)
}
