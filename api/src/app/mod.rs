//! What a job, a dataset, a run, a checkpoint and an evaluation are to a user.
//!
//! One file per resource, with the methods of [`App`] that read or change it and answer with the
//! types of [`wire`]. Routes and page call these, and nothing else calls the store.

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
use spec::JobKind;
use store::Store;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::access::{KnownTokens, Token};
use crate::app::events::Feed;
use crate::app::monitoring::Monitor;
use crate::app::shards::OpenShards;
use crate::error::ApiError;
use crate::limits::{
    CONCURRENT_DOWNLOADS, CONCURRENT_UPLOADS, CONNECTIONS, EVENT_HEARTBEAT, EVENT_STREAMS,
    LOG_READERS, MAX_TRAJECTORIES, MAX_UPLOAD_BYTES, REQUESTS_PER_SECOND, STREAMS, TRASH_DAYS,
    UPLOAD_STALL,
};
use crate::live::LiveModels;

pub use paging::Paging;
pub use questions::read as read_question;
pub use trash::dependent;

/// The server's version, as `/healthz` and the page show it.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// How the server is to behave.
#[derive(Clone, Debug)]
pub struct Options {
    /// A token of scope admin beside those of the store. Without any token everyone on this machine may do
    /// everything.
    pub token: Option<String>,
    /// The token of the process that serves, in which it asks itself.
    pub own_token: Option<String>,
    /// Trajectories of one simulation, at most.
    pub max_trajectories: u64,
    /// Seconds that an attempt at a task may take, of the kinds of jobs that have a limit.
    pub time_limits_s: HashMap<JobKind, u32>,
    /// Bytes of one file that is sent to be imported, at most.
    pub max_upload_bytes: u64,
    /// Bytes of all files together that are sent and kept, at most; as many as there is room for without.
    pub upload_quota_bytes: Option<u64>,
    /// How long a sender may take for the next bytes of a file.
    pub upload_stall: Duration,
    /// How long what was deleted can be restored.
    pub keep_deleted: Duration,
    /// Connections open at once.
    pub connections: usize,
    /// Requests per second of one address.
    pub requests_per_second: NonZero<u32>,
    /// How often a stream of events says that it is there while nothing happens.
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
    /// For the files on their way in.
    upload_places: Arc<Semaphore>,
    /// For the requests that wait for lines of a log.
    log_places: Arc<Semaphore>,
    /// For the files on their way out.
    download_places: Arc<Semaphore>,
    connections: usize,
    requests_per_second: NonZero<u32>,
    events: Feed,
    /// For the streams of events that are open.
    event_places: Arc<Semaphore>,
    event_heartbeat: Duration,
    models: Option<Arc<dyn LiveModels>>,
    /// For the streams that are open.
    stream_places: Arc<Semaphore>,
    /// Whether streams are to end.
    closing: watch::Sender<bool>,
    ending: Arc<AtomicBool>,
    monitor: Monitor,
}

impl App {
    pub fn new(store: Store, options: &Options) -> Self {
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
            download_places: Arc::new(Semaphore::new(CONCURRENT_DOWNLOADS)),
            connections: options.connections,
            requests_per_second: options.requests_per_second,
            events: Feed::new(),
            event_places: Arc::new(Semaphore::new(EVENT_STREAMS)),
            event_heartbeat: options.event_heartbeat,
            models: None,
            stream_places: Arc::new(Semaphore::new(STREAMS)),
            closing: watch::Sender::new(false),
            ending: Arc::default(),
            monitor: Monitor::new(),
        }
    }

    /// The same with something that computes predictions.
    pub fn with_models(self, models: Arc<dyn LiveModels>) -> Self {
        Self { models: Some(models), ..self }
    }

    /// The same with something that knows what memory trainings need. Without it none is doubted.
    pub fn with_memory_doubts(self, doubts: Arc<MemoryDoubts>) -> Self {
        Self { memory_doubts: Some(doubts), ..self }
    }

    /// Says from now on that requests should be sent to another server, and still answers them.
    pub fn announce_end(&self) {
        self.ending.store(true, Ordering::Relaxed);
    }

    pub(crate) fn is_ending(&self) -> bool {
        self.ending.load(Ordering::Relaxed)
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

    /// `None` when as many requests wait for lines of a log as may.
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

    pub(crate) fn stream_place(&self) -> Result<OwnedSemaphorePermit, ApiError> {
        let places = Arc::clone(&self.stream_places);
        places.try_acquire_owned().map_err(|_| ApiError::StreamsCrowded)
    }

    /// Done when streams are to end, and whatever else waits.
    pub(crate) fn closing(&self) -> impl Future<Output = ()> + Send + 'static {
        let mut closing = self.closing.subscribe();
        async move {
            // A sender that is gone says the same.
            let _ = closing.wait_for(|closing| *closing).await;
        }
    }

    pub(crate) fn close_streams(&self) {
        self.closing.send_replace(true);
    }

    /// Done when no stream is open and none can be opened any more.
    pub(crate) async fn streams_closed(&self) {
        let all = u32::try_from(STREAMS).unwrap_or(u32::MAX);
        let _ = self.stream_places.acquire_many(all).await;
    }
}
