//! What a server does beside answering: leases of dead workers, files nobody owns.

use std::time::{Duration, Instant, SystemTime};

use store::{Duty, DutyClaim, Reaped, Reaper, Store};
use tokio_util::sync::CancellationToken;

/// How often leases are looked at: how much later than its lease a death is noticed.
const REAP_EVERY: Duration = Duration::from_secs(1);

const SWEEP_EVERY: Duration = Duration::from_secs(60 * 60);

/// No file takes this long from its first byte to the row that names it; one that is sent to be
/// imported may take 6 h.
const ORPHANED_AFTER: Duration = Duration::from_secs(8 * 60 * 60);

/// Gives the tasks of workers that died to others.
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

/// Deletes what killed workers left half written. A clock that was set ahead, or a machine that slept, makes no file
/// older than it is.
pub async fn sweep(store: Store, stop: CancellationToken) {
    let mut duty = store.duty(Duty::Sweeping);
    let (began, began_by_clock) = (Instant::now(), SystemTime::now());
    loop {
        let by_clock = began_by_clock.elapsed().unwrap_or_default();
        let leapt = by_clock.saturating_sub(began.elapsed());
        if is_mine(&mut duty).await {
            match store.sweep_orphans(ORPHANED_AFTER + leapt).await {
                Ok(0) => {}
                Ok(count) => tracing::info!(count, "deleted files that nothing refers to"),
                Err(error) => {
                    let error = anyhow::Error::new(error);
                    tracing::error!("cannot delete files that nothing refers to: {error:#}");
                }
            }
        }
        if stop.run_until_cancelled(tokio::time::sleep(SWEEP_EVERY)).await.is_none() {
            return;
        }
    }
}

/// Whether this server is the one that does it; nobody's while the database does not answer.
async fn is_mine(duty: &mut DutyClaim) -> bool {
    duty.is_mine().await.unwrap_or_else(|error| {
        let error = anyhow::Error::new(error);
        tracing::warn!("cannot tell whether to keep house: {error:#}");
        false
    })
}
