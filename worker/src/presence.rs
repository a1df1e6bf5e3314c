//! Presence: shows that a worker is alive, and why it claims no tasks.
//!
//! A worker reports every ten seconds. It claims nothing while its disk is nearly full, or while a
//! database file is not the one that it opened.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use store::{Store, WorkerProcess};
use tokio_util::sync::CancellationToken;

use crate::WorkerOptions;

/// A worker in the store's list of workers.
pub struct Presence {
    store: Store,
    worker: WorkerProcess,
    waits_for: Mutex<Option<String>>,
}

/// Pause between two signs of life, well below [`Store::WORKER_SEEN_WITHIN`].
const INTERVAL: Duration = Duration::from_secs(10);

/// How long an absent database may delay the end of a worker.
const LEAVE_WITHIN: Duration = Duration::from_secs(2);

impl Presence {
    pub fn new(store: Store, options: &WorkerOptions) -> Self {
        let machine = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let threads = options.threads.unwrap_or(machine);
        let worker = WorkerProcess {
            name: options.name.clone(),
            host: options.host.clone(),
            pid: std::process::id(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            device: options.device.to_string(),
            threads: u32::try_from(threads).unwrap_or(u32::MAX),
            offers: options.offers.clone(),
        };
        Self { store, worker, waits_for: Mutex::default() }
    }

    /// Sets the reason why the worker claims no tasks; `None` if it claims them.
    pub fn waits_for(&self, obstacle: Option<String>) {
        let mut current = self.lock();
        match (&*current, &obstacle) {
            (None, Some(obstacle)) => tracing::warn!("claims no tasks: {obstacle}"),
            (Some(_), None) => tracing::info!("claims tasks again"),
            _ => {}
        }
        *current = obstacle;
    }

    /// Shows the worker until `over`. Errors of the database are ignored here; code that needs the
    /// database reports them.
    pub async fn show_until(&self, over: &CancellationToken) {
        let mut shown = self.store.register_worker(&self.worker).await;
        while over.run_until_cancelled(tokio::time::sleep(INTERVAL)).await.is_some() {
            shown = match shown {
                Ok(()) => {
                    let waits_for = self.lock().clone();
                    self.store.see_worker(&self.worker, waits_for.as_deref()).await
                }
                Err(_) => self.store.register_worker(&self.worker).await,
            };
        }
        let forgotten = tokio::time::timeout(LEAVE_WITHIN, self.store.forget_worker(&self.worker));
        if !matches!(forgotten.await, Ok(Ok(()))) {
            tracing::debug!("cannot leave the list of workers, which will show it as dead");
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.waits_for.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
