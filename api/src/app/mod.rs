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
pub mod compared;
pub mod datasets;
mod drawn;
mod evaluations;
pub mod events;
mod experiments;
pub mod files;
mod jobs;
pub mod labels;
mod lineage;
pub mod listing;
pub mod logged;
pub mod logs;
pub mod mlflow;
pub mod monitoring;
pub mod paging;
mod places;
mod predictions;
mod questions;
mod queue;
mod quota;
mod remembered;
pub mod resources;
pub mod robots;
mod room;
mod runs;
mod shards;
pub mod streams;
pub mod submission;
mod summaries;
pub mod tasks;
pub mod tokens;
mod torques;
pub mod trajectories;
pub mod trajectory_predictions;
mod trash;
mod uploads;
pub mod verifications;
mod waits;
mod workers;

use std::collections::HashMap;
use std::num::NonZero;
use std::sync::Arc;
use std::time::Duration;

use ::jobs::{Limits, MemoryDoubts};
use axum::extract::FromRef;
use spec::JobKind;
use store::Store;

use crate::access::Access;
use crate::app::events::Feed;
use crate::app::monitoring::Monitor;
use crate::app::places::Places;
use crate::app::remembered::RememberedPredictions;
use crate::app::shards::OpenShards;
use crate::checks::Checks;
use crate::limits::{
    CONNECTIONS, EVENT_HEARTBEAT, FAILED_LOGINS_PER_MINUTE, MAX_TRAJECTORIES, MAX_UPLOAD_BYTES,
    REQUESTS_PER_SECOND, TRASH_DAYS, UPLOAD_STALL,
};
use crate::live::LiveModels;
use crate::remote::TrustedProxy;

pub use paging::Paging;

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
    options: Arc<Options>,
    limits: Arc<Limits>,
    memory_doubts: Option<Arc<MemoryDoubts>>,
    access: Access,
    places: Places,
    checks: Checks,
    open_shards: OpenShards,
    feed: Feed,
    models: Option<Arc<dyn LiveModels>>,
    remembered: RememberedPredictions,
    monitor: Monitor,
}

impl FromRef<App> for Checks {
    fn from_ref(app: &App) -> Self {
        app.checks.clone()
    }
}

impl App {
    /// The service on a store, without live predictions and without warnings about memory.
    pub fn new(store: Store, options: &Options) -> Self {
        Self {
            options: Arc::new(options.clone()),
            limits: Arc::new(Limits {
                max_trajectories: options.max_trajectories,
                time_limits_s: options.time_limits_s.clone(),
            }),
            memory_doubts: None,
            access: Access::new(
                store.clone(),
                options.token.as_deref(),
                options.own_token.as_deref(),
                options.failed_logins_per_minute,
            ),
            places: Places::new(options.connections),
            checks: Checks::new(),
            open_shards: OpenShards::new(),
            feed: Feed::new(),
            models: None,
            remembered: RememberedPredictions::new(),
            monitor: Monitor::new(),
            store,
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
        self.places.announce_end();
    }

    pub(crate) fn options(&self) -> &Options {
        &self.options
    }

    pub(crate) fn access(&self) -> &Access {
        &self.access
    }

    pub(crate) fn places(&self) -> &Places {
        &self.places
    }
}
