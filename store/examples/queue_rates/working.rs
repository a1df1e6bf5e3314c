//! A process of workers. It prints `ready` when all are connected, and then obeys the lines that it
//! reads: `go` lets them begin, and `count` prints how many tasks they have completed. At the end
//! of its input it prints a report and ends.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::json;
use spec::Resources;
use store::{Access, Bell, Location, Store, StoreError, WorkerProcess};
use tokio::io::{AsyncBufReadExt, BufReader};

use crate::{Outcome, now_us};

/// The version of the server and of the workers, which compare it.
pub const VERSION: &str = "bench";

/// The same as in torqued's worker (`worker/src/claim_loop.rs`, `worker/src/presence.rs`), whose
/// claim loop this is.
const KNOWN_FOR: Duration = Duration::from_secs(1);
const RETRY: Duration = Duration::from_secs(2);
const SHOW_EVERY: Duration = Duration::from_secs(10);
const LEASE: Duration = Duration::from_secs(15);

#[derive(Default)]
struct Work {
    completed: AtomicU64,
    /// Time from each task's submission to its claim, in microseconds.
    waits_us: Mutex<Vec<u64>>,
}

pub async fn run(place: &Location, workers: u32) -> Outcome<()> {
    let work = Arc::new(Work::default());
    let mut stores = Vec::new();
    for _ in 0..workers {
        stores.push(Store::open_at(place, Access::Worker).await?);
    }
    println!("ready");
    let mut lines = BufReader::new(tokio::io::stdin()).lines();
    while let Some(line) = lines.next_line().await? {
        match line.as_str() {
            "go" => {
                for (number, store) in stores.drain(..).enumerate() {
                    let name = format!("{}-{number}", std::process::id());
                    tokio::spawn(show(store.clone(), name.clone()));
                    tokio::spawn(claim_and_complete(store, name, Arc::clone(&work)));
                }
            }
            "count" => println!("{}", work.completed.load(Ordering::Relaxed)),
            other => return Err(format!("what is {other:?}?").into()),
        }
    }
    let waits = work.waits_us.lock().unwrap_or_else(PoisonError::into_inner);
    println!("{}", json!({"waits_us": *waits}));
    // Work in progress does not matter any more.
    std::process::exit(0);
}

/// Reports regularly that a worker is alive.
async fn show(store: Store, name: String) {
    let process = WorkerProcess {
        name,
        host: "localhost".to_owned(),
        pid: std::process::id(),
        version: VERSION.to_owned(),
        device: "cpu".to_owned(),
        threads: 1,
        offers: Resources::default(),
    };
    let mut shown = store.register_worker(&process).await;
    loop {
        if let Err(error) = shown {
            eprintln!("{}: {error}", process.name);
        }
        tokio::time::sleep(SHOW_EVERY).await;
        shown = store.see_worker(&process, None).await;
    }
}

async fn claim_and_complete(store: Store, name: String, work: Arc<Work>) {
    let mut bell = None;
    let mut looked_at = None;
    loop {
        let looked = next(&store, &name, &mut bell, &mut looked_at, &work).await;
        if let Err(error) = looked {
            eprintln!("{name}: {error}");
            bell = None;
            tokio::time::sleep(RETRY).await;
        }
    }
}

/// Completes the next task, or waits until there may be one.
async fn next(
    store: &Store,
    name: &str,
    bell: &mut Option<Bell>,
    looked_at: &mut Option<Instant>,
    work: &Work,
) -> Result<(), StoreError> {
    let _ = store.obstacle();
    let nothing = Resources::default();
    let lately = looked_at.take().filter(|at| at.elapsed() < KNOWN_FOR);
    let may_claim = lately.is_some() || store.poll(name, &nothing).await?.is_any_claimable;
    let claimed = if may_claim { store.claim(name, &nothing, LEASE).await? } else { None };
    let Some(task) = claimed else {
        match bell {
            // Tasks that were queued before it listened are looked for once more.
            None => *bell = Some(store.bell().await?),
            Some(bell) => bell.wait(bell.patience()).await?,
        }
        return Ok(());
    };
    *looked_at = lately.or_else(|| Some(Instant::now()));
    let waited = now_us().saturating_sub(task.payload.as_u64().unwrap_or_default());
    work.waits_us.lock().unwrap_or_else(PoisonError::into_inner).push(waited);
    bell.iter_mut().for_each(Bell::task_found);
    store.complete(task.fence, None).await?;
    work.completed.fetch_add(1, Ordering::Relaxed);
    Ok(())
}
