//! The operations of the service in the user's terms: jobs, datasets, runs, checkpoints,
//! evaluations.
//!
//! There is one file per resource. It has the methods of [`App`] that read or change the resource
//! and answer with the types of [`wire`]. Routes and pages call these methods, and nothing else
//! calls the store.

mod archive;
mod attempts;
mod audit;
pub mod checkpoints;
mod datasets;
mod drawn;
mod evaluations;
pub mod events;
mod experiments;
pub mod files;
mod jobs;
pub mod labels;
pub mod listing;
pub mod logs;
pub mod mlflow;
pub mod monitoring;
pub mod paging;
mod predictions;
mod questions;
mod queue;
mod quota;
mod runs;
mod sessions;
mod shards;
pub mod streams;
pub mod submission;
mod summaries;
pub mod tasks;
pub mod tokens;
pub mod trajectories;
mod trash;
mod uploads;
pub mod verifications;
mod waits;
mod workers;

use std::collections::HashMap;
use std::num::NonZero;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ::jobs::{Limits, MemoryDoubts};
use axum::extract::FromRef;
use spec::JobKind;
use store::Store;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::access::{FailedLogins, KnownTokens, Token};
use crate::app::events::Feed;
use crate::app::monitoring::Monitor;
use crate::app::shards::OpenShards;
use crate::checks::Checks;
use crate::error::ApiError;
use crate::limits::{
    CONCURRENT_DOWNLOADS, CONCURRENT_UPLOADS, CONNECTIONS, EVENT_HEARTBEAT, EVENT_STREAMS,
    FAILED_LOGINS_PER_MINUTE, LOG_READERS, MAX_TRAJECTORIES, MAX_UPLOAD_BYTES, REQUESTS_PER_SECOND,
    STREAMS, TRASH_DAYS, UPLOAD_STALL,
};
use crate::live::LiveModels;
use crate::remote::{TrustedProxies, TrustedProxy};

pub use paging::Paging;
pub use trash::dependent;

/// The server's version, which `/healthz` and the page show.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Options of the server.
#[derive(Clone, Debug)]
pub struct Options {
    /// A token of scope admin, in addition to those in the store. Without any token, everybody on
    /// this machine may do everything.
    pub token: Option<String>,
    /// The token for the server process's own requests.
    pub own_token: Option<String>,
    /// Largest number of trajectories of a simulation.
    pub max_trajectories: u64,
    /// Time limit of an attempt at a task in seconds, by kind of job, for the kinds that have one.
    pub time_limits_s: HashMap<JobKind, u32>,
    /// Largest number of bytes of a file that is sent for an import.
    pub max_upload_bytes: u64,
    /// Largest number of bytes of all sent files together; `None` for no limit.
    pub upload_quota_bytes: Option<u64>,
    /// How long a sender may take for the next bytes of a file.
    pub upload_stall: Duration,
    /// How long deleted things can be restored.
    pub keep_deleted: Duration,
    /// Largest number of open connections.
    pub connections: usize,
    /// Requests per second from one address.
    pub requests_per_second: NonZero<u32>,
    /// Failed logins and wrong tokens per minute from one address.
    pub failed_logins_per_minute: NonZero<u32>,
    /// Proxies that name their clients.
    pub trusted_proxies: Vec<TrustedProxy>,
    /// How often a silent stream of events sends a sign of life.
    pub event_heartbeat: Duration,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            token: None,
            own_token: None,
            max_trajectories: MAX_TRAJECTORIES,
            time_limits_s: HashMap::new(),
            max_upload_bytes: MAX_UPLOAD_BYTES,
            upload_quota_bytes: None,
            upload_stall: UPLOAD_STALL,
            keep_deleted: Duration::from_secs(u64::from(TRASH_DAYS) * 24 * 60 * 60),
            connections: CONNECTIONS,
            requests_per_second: const { NonZero::new(REQUESTS_PER_SECOND).unwrap() },
            failed_logins_per_minute: const { NonZero::new(FAILED_LOGINS_PER_MINUTE).unwrap() },
            trusted_proxies: Vec::new(),
            event_heartbeat: EVENT_HEARTBEAT,
        }
    }
}

/// The service behind the routes. Clones share it.
#[derive(Clone)]
pub struct App {
    store: Store,
    open_shards: OpenShards,
    token: Option<Token>,
    own_token: Option<Token>,
    tokens: KnownTokens,
    limits: Arc<Limits>,
    max_upload_bytes: u64,
    upload_quota_bytes: Option<u64>,
    upload_stall: Duration,
    keep_deleted: Duration,
    memory_doubts: Option<Arc<MemoryDoubts>>,
    /// Permits for files that are being received.
    upload_places: Arc<Semaphore>,
    /// Permits for requests that wait for lines of a log.
    log_places: Arc<Semaphore>,
    /// Permits for files that are being sent.
    download_places: Arc<Semaphore>,
    connections: usize,
    requests_per_second: NonZero<u32>,
    failures: FailedLogins,
    trusted_proxies: TrustedProxies,
    events: Feed,
    /// Permits for open streams of events.
    event_places: Arc<Semaphore>,
    event_heartbeat: Duration,
    checks: Checks,
    models: Option<Arc<dyn LiveModels>>,
    /// Permits for open prediction streams.
    stream_places: Arc<Semaphore>,
    /// Whether streams have to end.
    closing: watch::Sender<bool>,
    ending: Arc<AtomicBool>,
    monitor: Monitor,
}

impl FromRef<App> for Checks {
    fn from_ref(app: &App) -> Self {
        app.checks()
    }
}

impl App {
    pub fn new(store: Store, options: &Options) -> Self {
        // Long answers get a part of the connections, so that some are left for short ones.
        let part = |limit: usize, of: usize| limit.min(options.connections / of).max(1);
        Self {
            store,
            open_shards: OpenShards::new(),
            token: options.token.as_deref().map(Token::new),
            own_token: options.own_token.as_deref().map(Token::new),
            tokens: KnownTokens::default(),
            limits: Arc::new(Limits {
                max_trajectories: options.max_trajectories,
                time_limits_s: options.time_limits_s.clone(),
            }),
            max_upload_bytes: options.max_upload_bytes,
            upload_quota_bytes: options.upload_quota_bytes,
            upload_stall: options.upload_stall,
            keep_deleted: options.keep_deleted,
            memory_doubts: None,
            upload_places: Arc::new(Semaphore::new(CONCURRENT_UPLOADS)),
            log_places: Arc::new(Semaphore::new(LOG_READERS)),
            download_places: Arc::new(Semaphore::new(part(CONCURRENT_DOWNLOADS, 8))),
            connections: options.connections,
            requests_per_second: options.requests_per_second,
            failures: FailedLogins::new(options.failed_logins_per_minute),
            trusted_proxies: TrustedProxies::new(&options.trusted_proxies),
            events: Feed::new(),
            event_places: Arc::new(Semaphore::new(part(EVENT_STREAMS, 4))),
            event_heartbeat: options.event_heartbeat,
            checks: Checks::new(),
            models: None,
            stream_places: Arc::new(Semaphore::new(STREAMS)),
            closing: watch::Sender::new(false),
            ending: Arc::default(),
            monitor: Monitor::new(),
        }
    }

    /// The service with models for live predictions.
    pub fn with_models(self, models: Arc<dyn LiveModels>) -> Self {
        Self { models: Some(models), ..self }
    }

    /// The service with warnings about the memory of trainings. Without it there are none.
    pub fn with_memory_doubts(self, doubts: Arc<MemoryDoubts>) -> Self {
        Self { memory_doubts: Some(doubts), ..self }
    }

    /// From now on, announces that requests should go to another server. Requests are still
    /// answered.
    pub fn announce_end(&self) {
        self.ending.store(true, Ordering::Relaxed);
    }

    pub(crate) fn is_ending(&self) -> bool {
        self.ending.load(Ordering::Relaxed)
    }

    pub(crate) fn checks(&self) -> Checks {
        self.checks.clone()
    }

    pub(crate) fn max_upload_bytes(&self) -> u64 {
        self.max_upload_bytes
    }

    pub(crate) fn keep_deleted(&self) -> Duration {
        self.keep_deleted
    }

    pub(crate) fn upload_stall(&self) -> Duration {
        self.upload_stall
    }

    /// A permit to wait for lines of a log; `None` if too many requests wait.
    pub(crate) fn log_place(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.log_places).try_acquire_owned().ok()
    }

    pub(crate) fn download_place(&self) -> Result<OwnedSemaphorePermit, ApiError> {
        let places = Arc::clone(&self.download_places);
        places.try_acquire_owned().map_err(|_| ApiError::DownloadsCrowded)
    }

    pub(crate) fn event_place(&self) -> Result<OwnedSemaphorePermit, ApiError> {
        let places = Arc::clone(&self.event_places);
        places.try_acquire_owned().map_err(|_| ApiError::EventsCrowded)
    }

    pub(crate) fn event_heartbeat(&self) -> Duration {
        self.event_heartbeat
    }

    pub(crate) fn connections(&self) -> usize {
        self.connections
    }

    pub(crate) fn requests_per_second(&self) -> NonZero<u32> {
        self.requests_per_second
    }

    pub(crate) fn failures(&self) -> &FailedLogins {
        &self.failures
    }

    pub(crate) fn trusted_proxies(&self) -> TrustedProxies {
        self.trusted_proxies.clone()
    }

    pub(crate) fn stream_place(&self) -> Result<OwnedSemaphorePermit, ApiError> {
        let places = Arc::clone(&self.stream_places);
        places.try_acquire_owned().map_err(|_| ApiError::StreamsCrowded)
    }

    /// Completes when streams and other waiting requests have to end.
    pub(crate) fn closing(&self) -> impl Future<Output = ()> + Send + 'static {
        let mut closing = self.closing.subscribe();
        async move {
            // If the sender is gone, they have to end too.
            let _ = closing.wait_for(|closing| *closing).await;
        }
    }

    pub(crate) fn close_streams(&self) {
        self.closing.send_replace(true);
    }

    /// Completes when no stream is open and none can be opened any more.
    pub(crate) async fn streams_closed(&self) {
        let all = u32::try_from(STREAMS).unwrap_or(u32::MAX);
        let _ = self.stream_places.acquire_many(all).await;
    }
}
