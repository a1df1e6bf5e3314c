//! Metrics for a monitoring system. The server counts requests as it answers them, and the store
//! when the system asks.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::http::{Method, StatusCode};
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;
use store::{Census, DiskSpace, Queue};
use tokio::sync::Mutex;
use wire::Worker;

use crate::app::{App, VERSION};
use crate::error::ApiError;

/// The media type of the answer.
pub const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The prefix of all names.
const PREFIX: &str = "torqued";

/// Upper bounds of the histogram of response times, s.
const SECONDS: [f64; 11] = [0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 10.0];

/// How long counts of the store are reused, because counting many rows takes time.
const CENSUS_KEPT: Duration = Duration::from_secs(10);

/// The route label of requests without a route.
const NO_ROUTE: &str = "none";

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct RequestLabels {
    method: &'static str,
    route: String,
    status: u16,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct KindLabels {
    kind: String,
    state: &'static str,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct OutcomeLabels {
    kind: String,
    outcome: &'static str,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct StateLabels {
    state: &'static str,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq, EncodeLabelSet)]
struct VersionLabels {
    version: &'static str,
}

/// Counts of the requests since this server started, and the last census of the store.
#[derive(Clone)]
pub struct Monitor {
    requests: Family<RequestLabels, Histogram>,
    census: Arc<Mutex<Option<(Instant, Census)>>>,
}

impl Monitor {
    pub fn new() -> Self {
        let histogram: fn() -> Histogram = || Histogram::new(SECONDS);
        Self { requests: Family::new_with_constructor(histogram), census: Arc::default() }
    }
}

/// The label of a method. There are only a few, whatever clients send.
fn name(method: &Method) -> &'static str {
    const KNOWN: [&str; 7] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"];
    KNOWN.into_iter().find(|known| *known == method.as_str()).unwrap_or("other")
}

impl App {
    /// Counts a request, and the time until its answer began.
    pub(crate) fn count_request(
        &self,
        method: &Method,
        route: Option<&str>,
        status: StatusCode,
        elapsed: Duration,
    ) {
        let route = route.unwrap_or(NO_ROUTE).to_owned();
        let asked = RequestLabels { method: name(method), route, status: status.as_u16() };
        self.monitor.requests.get_or_create(&asked).observe(elapsed.as_secs_f64());
    }

    /// All metrics, in the text format of OpenMetrics.
    pub(crate) async fn metrics(&self) -> Result<String, ApiError> {
        let census = self.census().await?;
        let queue = self.store.queue().await?;
        let workers = self.workers().await?.workers;
        let mut registry = Registry::with_prefix(PREFIX);
        let build = Family::<VersionLabels, Gauge>::default();
        build.get_or_create(&VersionLabels { version: VERSION }).set(1);
        registry.register("build_info", "The version of the server", build);
        registry.register(
            "http_request_duration_seconds",
            "Time from a request to the beginning of its answer, by route",
            self.monitor.requests.clone(),
        );
        tell_census(&mut registry, census);
        tell_queue(&mut registry, &queue);
        tell_workers(&mut registry, &workers);
        let DiskSpace { free_bytes, reserved_bytes } = self.store.disk_space()?;
        gauge(
            &mut registry,
            "disk_free_bytes",
            "Free space on the disk of the data folder",
            free_bytes,
        );
        let what = "Free space below which no task is claimed";
        gauge(&mut registry, "disk_reserved_bytes", what, reserved_bytes);
        let what = "Size of all sent files that are kept";
        gauge(&mut registry, "sent_bytes", what, self.store.sent_bytes().await?);
        if let Some(quota) = self.options.upload_quota_bytes {
            gauge(
                &mut registry,
                "sent_quota_bytes",
                "Largest size of all sent files together",
                quota,
            );
        }
        let mut text = String::new();
        // Writing to a String cannot fail.
        encode(&mut text, &registry).map_err(|_| ApiError::Internal)?;
        Ok(text)
    }

    /// The census of the store. Concurrent requests share one count.
    async fn census(&self) -> Result<Census, ApiError> {
        let mut kept = self.monitor.census.lock().await;
        if let Some((at, census)) = &*kept
            && at.elapsed() < CENSUS_KEPT
        {
            return Ok(census.clone());
        }
        let census = self.store.census().await?;
        *kept = Some((Instant::now(), census.clone()));
        Ok(census)
    }
}

fn tell_census(registry: &mut Registry, census: Census) {
    let jobs = Family::<KindLabels, Gauge>::default();
    for (kind, state, number) in census.jobs {
        jobs.get_or_create(&KindLabels { kind, state: state.as_str() }).set(signed(number));
    }
    registry.register("jobs", "Jobs by kind and state", jobs);

    let tasks = Family::<KindLabels, Gauge>::default();
    for (kind, state, number) in census.tasks {
        tasks.get_or_create(&KindLabels { kind, state: state.as_str() }).set(signed(number));
    }
    registry.register("tasks", "Tasks by kind of job and state", tasks);

    let attempts = Family::<OutcomeLabels, Counter>::default();
    for (kind, outcome, number) in census.attempts {
        if let Some(outcome) = outcome {
            attempts
                .get_or_create(&OutcomeLabels { kind, outcome: outcome.as_str() })
                .inc_by(number);
        }
    }
    registry.register("attempts", "Ended attempts at tasks, by kind of job and outcome", attempts);
}

fn tell_queue(registry: &mut Registry, queue: &Queue) {
    gauge(registry, "queue_queued_tasks", "Tasks that may be claimed, now or later", queue.queued);
    gauge(registry, "queue_running_tasks", "Tasks that workers have", queue.running);
    let is_paused = u64::from(queue.paused_at.is_some());
    gauge(registry, "queue_paused", "1 while the queue is paused", is_paused);
}

fn tell_workers(registry: &mut Registry, workers: &[Worker]) {
    let states = Family::<StateLabels, Gauge>::default();
    for state in ["busy", "idle", "drained", "dead"] {
        states.get_or_create(&StateLabels { state }).set(0);
    }
    for worker in workers {
        states.get_or_create(&StateLabels { state: state(worker) }).inc();
    }
    registry.register("workers", "Workers by state", states);
    tell_resources(registry, workers);
}

/// A worker has one task at a time, so that a task uses all that its worker offers.
fn tell_resources(registry: &mut Registry, workers: &[Worker]) {
    let mut offered = Resources::default();
    let mut in_use = Resources::default();
    for worker in workers.iter().filter(|worker| worker.alive) {
        offered.add(worker);
        if worker.task.is_some() {
            in_use.add(worker);
        }
    }
    for (resources, suffix, whose) in [
        (offered, "", "that live workers offer"),
        (in_use, "_in_use", "of live workers that have a task"),
    ] {
        let Resources { cpus, gpus, memory_bytes } = resources;
        let told = [
            ("cpus", "", "Processors", cpus),
            ("gpus", "", "GPUs", gpus),
            ("memory", "_bytes", "Memory", memory_bytes),
        ];
        for (name, unit, what, amount) in told {
            let name = format!("worker_{name}{suffix}{unit}");
            gauge(registry, &name, &format!("{what} {whose}"), amount);
        }
    }
}

/// Amounts of several workers together.
#[derive(Default)]
struct Resources {
    cpus: u64,
    gpus: u64,
    memory_bytes: u64,
}

impl Resources {
    fn add(&mut self, worker: &Worker) {
        let offers = &worker.offers;
        self.cpus += u64::from(offers.cpus.unwrap_or(worker.threads));
        self.gpus += u64::from(offers.gpus);
        self.memory_bytes += offers.memory_gb.map_or(0, bytes);
    }
}

/// Memory is offered to the megabyte.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a whole number of bytes, 100 000 GB at most"
)]
fn bytes(gigabytes: f64) -> u64 {
    const MEGABYTE: u64 = 1_000_000;
    (gigabytes * 1000.0).round().max(0.0) as u64 * MEGABYTE
}

/// The state of a worker. A drained worker may still have a task.
fn state(worker: &Worker) -> &'static str {
    match worker {
        Worker { alive: false, .. } => "dead",
        Worker { drained_at: Some(_), .. } => "drained",
        Worker { task: Some(_), .. } => "busy",
        _ => "idle",
    }
}

fn gauge(registry: &mut Registry, name: &str, help: &str, value: u64) {
    let gauge = Gauge::<i64>::default();
    gauge.set(signed(value));
    registry.register(name, help, gauge);
}

fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}
