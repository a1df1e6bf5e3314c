//! Housekeeping of a server: leases of dead workers, files without an owner, the trash and old
//! events.

use std::time::{Duration, Instant, SystemTime};

use store::{
    Duty, DutyClaim, EVENTS_KEPT, EVENTS_KEPT_FOR, Reaped, Reaper, Retention, Ripe, Store,
    StoreError, Sweeper, Swept,
};
use tokio_util::sync::CancellationToken;

use crate::arguments::ORPHANED_AFTER;

/// How often leases are checked. A death is noticed at most this long after its lease has ended.
const REAP_EVERY: Duration = Duration::from_secs(1);

const FORGET_ENGINES_EVERY: Duration = Duration::from_secs(10);

const SWEEP_EVERY: Duration = Duration::from_secs(60 * 60);

/// Number of files that the announcement of a sweep names. The others are counted.
const NAMED: usize = 20;

const FORGET_EVENTS_EVERY: Duration = Duration::from_secs(60);

/// How long things are kept.
#[derive(Clone, Copy, Debug)]
pub struct Keeping {
    pub retention: Retention,
    /// In the trash.
    pub trash: Duration,
}

/// Gives the tasks of dead workers to others.
pub async fn reap(store: Store, stop: CancellationToken) {
    let mut reaper = Reaper::new(store.clone(), REAP_EVERY);
    let mut duty = store.duty(Duty::Reaping);
    let mut looked = Instant::now();
    while stop.run_until_cancelled(tokio::time::sleep(REAP_EVERY)).await.is_some() {
        let since = looked.elapsed();
        looked += since;
        if !is_mine(&mut duty).await {
            reaper = Reaper::new(store.clone(), REAP_EVERY);
            continue;
        }
        match reaper.look(since).await {
            Ok(Reaped { queued: 0, failed: 0, cancelled: 0 }) => {}
            Ok(Reaped { queued, failed, cancelled }) => {
                tracing::warn!(
                    queued,
                    failed,
                    cancelled,
                    "workers died; their tasks were taken back"
                );
            }
            Err(error) => {
                let error = anyhow::Error::new(error);
                tracing::error!("cannot look for expired leases: {error:#}");
            }
        }
    }
}

/// Removes the engine of a server that died, so that nobody waits for workers that it would have
/// requested.
pub async fn forget_engines(store: Store, stop: CancellationToken) {
    while stop.run_until_cancelled(tokio::time::sleep(FORGET_ENGINES_EVERY)).await.is_some() {
        if let Err(error) = forget_engine(&store).await {
            let error = anyhow::Error::new(error);
            tracing::warn!("cannot tell whether a server asks an engine for workers: {error:#}");
        }
    }
}

/// Removes the engine unless a server uses it. Such a server has the duty as long as it lives.
pub async fn forget_engine(store: &Store) -> Result<(), StoreError> {
    if store.engine().await?.is_some() && store.duty(Duty::Placing).is_mine().await? {
        store.set_engine(None).await?;
    }
    Ok(())
}

/// Deletes files that killed workers left, an hour after it named them in the log, and things whose time in the trash is over.
/// Nothing appears older because a clock was set ahead or the machine slept.
pub async fn sweep(store: Store, keeping: Keeping, stop: CancellationToken) {
    let mut duty = store.duty(Duty::Sweeping);
    let mut sweeper = Sweeper::new(store.clone());
    let (began, began_by_clock) = (Instant::now(), SystemTime::now());
    loop {
        let by_clock = began_by_clock.elapsed().unwrap_or_default();
        let leapt = by_clock.saturating_sub(began.elapsed());
        if is_mine(&mut duty).await {
            match sweeper.sweep(ORPHANED_AFTER + leapt).await {
                Ok(swept) => report(&swept),
                Err(error) => {
                    let error = anyhow::Error::new(error);
                    tracing::error!("cannot delete files that nothing refers to: {error:#}");
                }
            }
            retire(&store, keeping).await;
            purge(&store, leapt).await;
        }
        if stop.run_until_cancelled(tokio::time::sleep(SWEEP_EVERY)).await.is_none() {
            return;
        }
    }
}

/// Logs what a sweep deleted, and names what the next one deletes.
fn report(swept: &Swept) {
    let Swept { deleted, announced, bytes } = swept;
    if *deleted > 0 {
        tracing::info!(count = deleted, "deleted files that nothing refers to");
    }
    if announced.is_empty() {
        return;
    }
    let named = announced.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = match announced.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let count = announced.len();
    tracing::info!(
        count,
        bytes,
        "in an hour, these files that nothing refers to are deleted: {named}{more}"
    );
}

async fn retire(store: &Store, Keeping { retention, trash }: Keeping) {
    match store.retire(retention, trash).await {
        Ok(retired) if retired.is_empty() => {}
        Ok(retired) => {
            tracing::info!(count = retired.len(), "moved what is kept no longer into the trash");
        }
        Err(error) => {
            let error = anyhow::Error::new(error);
            tracing::error!("cannot move what is kept no longer into the trash: {error:#}");
        }
    }
    let Some(age) = retention.logs else { return };
    match store.delete_old_logs(age).await {
        Ok(0) => {}
        Ok(jobs) => tracing::info!(jobs, "deleted the logs of jobs that ended long ago"),
        Err(error) => {
            let error = anyhow::Error::new(error);
            tracing::error!("cannot delete old logs: {error:#}");
        }
    }
}

async fn purge(store: &Store, leap: Duration) {
    match store.purge(Ripe::AtItsDate { leap }).await {
        Ok(deleted) if deleted.is_empty() => {}
        Ok(deleted) => {
            let bytes: u64 = deleted.iter().map(|garbage| garbage.bytes).sum();
            tracing::info!(count = deleted.len(), bytes, "permanently deleted things in the trash");
        }
        Err(error) => {
            let error = anyhow::Error::new(error);
            tracing::error!("cannot empty the trash: {error:#}");
        }
    }
}

/// Deletes old events, and the oldest ones if there are too many.
pub async fn forget_events(store: Store, stop: CancellationToken) {
    let mut duty = store.duty(Duty::Forgetting);
    while stop.run_until_cancelled(tokio::time::sleep(FORGET_EVENTS_EVERY)).await.is_some() {
        if is_mine(&mut duty).await
            && let Err(error) = store.forget_events(EVENTS_KEPT, EVENTS_KEPT_FOR).await
        {
            let error = anyhow::Error::new(error);
            tracing::error!("cannot forget old events: {error:#}");
        }
    }
}

/// Whether this server has the duty. No server has it while the database does not answer.
async fn is_mine(duty: &mut DutyClaim) -> bool {
    duty.is_mine().await.unwrap_or_else(|error| {
        let error = anyhow::Error::new(error);
        tracing::warn!("cannot tell whether this server has the duty: {error:#}");
        false
    })
}
