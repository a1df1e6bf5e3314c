//! Claims tasks one after the other, and runs each until it ends or has to stop.

use std::any::Any;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use models::{Device, DeviceKind};
use recordings::DecoderProgram;
use spec::Resources;
use store::{Access, Bell, ClaimedTask, Location, Store, StoreError};
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;

use crate::WorkerError;
use crate::attempt::Attempt;
use crate::attempt_log::AttemptLog;
use crate::attempt_log::CurrentAttempt;
use crate::error::TaskError;
use crate::heartbeat::{LeaseTerms, ProgressCell, keep_alive};
use crate::held_task::HeldTask;
use crate::kinds::{KindModule, module};
use crate::presence::Presence;
use crate::stop::{StopReason, StopSignal};

/// Options of a worker.
#[derive(Clone, Debug)]
pub struct WorkerOptions {
    /// The store of the worker's server.
    pub location: Location,
    /// Its name, shown beside its tasks. It is unique among workers, so that people can tell them
    /// apart.
    pub name: String,
    /// The machine's name.
    pub host: String,
    /// Number of threads for computing; `None` for all cores.
    pub threads: Option<usize>,
    /// It takes tasks that ask for no more than this.
    pub offers: Resources,
    /// How long a lease lasts without a heartbeat. A death is noticed after this time.
    pub lease: Duration,
    /// How long to look for a task before the worker ends; `None` for ever.
    pub idle_exit: Option<Duration>,
    /// Whether to work for a server of another version too.
    pub any_version: bool,
    /// The device that computes models.
    pub device: DeviceKind,
    /// The program that decodes files of other formats.
    pub decoder: DecoderProgram,
    /// Receives the lines that this process logs.
    pub log: AttemptLog,
}

/// How long a worker that has tasks relies on its last poll, which read the server's version.
const KNOWN_FOR: Duration = Duration::from_secs(1);

/// How long a busy worker keeps its bell, so that it need not connect again after each of many
/// short tasks.
const BELL_KEPT: Duration = Duration::from_secs(2);

/// Pause between two tries when the database did not answer, or while the disk has no room.
const RETRY: Duration = Duration::from_secs(2);

/// Executes tasks until `shutdown`, or until no task was found for `idle_exit`. On `shutdown` it
/// gives its task back. While the disk is nearly full it claims no task, because one after the
/// other would fail.
///
/// # Errors
/// When the data folder or the device cannot be opened, the device failed, or work does not end
/// when it is told to. A failed task is not an error of the worker.
pub async fn run(options: &WorkerOptions, shutdown: CancellationToken) -> Result<(), WorkerError> {
    if let Some(threads) = options.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()
            .map_err(|source| WorkerError::Threads { threads, source })?;
    }
    let device = Device::open(options.device)?;
    let store = Store::open_at(&options.location, Access::Worker).await?;
    let presence = Presence::new(store.clone(), options);
    let over = CancellationToken::new();
    let working = async {
        let worked = work_on(&store, &device, options, &presence, &shutdown).await;
        over.cancel();
        worked
    };
    let (worked, ()) = tokio::join!(working, presence.show_until(&over));
    worked
}

/// Claims and executes tasks until `shutdown`, or until no task was found for long enough.
///
/// # Errors
/// Like [`execute`].
async fn work_on(
    store: &Store,
    device: &Device,
    options: &WorkerOptions,
    presence: &Presence,
    shutdown: &CancellationToken,
) -> Result<(), WorkerError> {
    let mut bell = None;
    let mut search = Search::new(store, options);
    let mut idle_since = Instant::now();
    while !shutdown.is_cancelled() {
        if options.idle_exit.is_some_and(|idle| idle_since.elapsed() >= idle) {
            tracing::info!("ends: it found no task for {} s", idle_since.elapsed().as_secs());
            return Ok(());
        }
        let found = search.next_task().await;
        presence.waits_for(match &found {
            Ok(SearchResult::Obstacle(obstacle)) => Some(obstacle.clone()),
            _ => None,
        });
        let pause = match found {
            Ok(SearchResult::Task(task)) => {
                bell.iter_mut().for_each(Bell::task_found);
                let mut execution = pin!(execute(store, device, *task, options, shutdown));
                match tokio::time::timeout(BELL_KEPT, &mut execution).await {
                    Ok(ended) => ended?,
                    Err(_) => {
                        bell = None;
                        execution.await?;
                    }
                }
                idle_since = Instant::now();
                Duration::ZERO
            }
            Ok(SearchResult::Nothing) => {
                let wait = wait_for_a_task(store, &mut bell);
                let _ = shutdown.run_until_cancelled(wait).await;
                Duration::ZERO
            }
            Ok(SearchResult::Obstacle(_)) => RETRY,
            Err(error) => {
                tracing::error!(error = spec::causes(&error), "cannot look for a task");
                RETRY
            }
        };
        tokio::select! {
            () = shutdown.cancelled() => {}
            () = tokio::time::sleep(pause) => {}
        }
    }
    Ok(())
}

/// Waits until there may be a task. The first call only begins to listen and returns, because tasks
/// queued before need one more poll.
async fn wait_for_a_task(store: &Store, bell: &mut Option<Bell>) {
    let listened = match bell {
        None => match store.bell().await {
            Ok(new) => {
                *bell = Some(new);
                return;
            }
            Err(error) => Err(error),
        },
        Some(bell) => bell.wait(bell.patience()).await,
    };
    if let Err(error) = listened {
        tracing::warn!(error = spec::causes(&error), "cannot listen for tasks");
        *bell = None;
        tokio::time::sleep(RETRY).await;
    }
}

/// A worker's search for its next task.
struct Search<'a> {
    store: &'a Store,
    options: &'a WorkerOptions,
    /// The moment of the last poll, if every claim since then got a task.
    polled_at: Option<Instant>,
}

enum SearchResult {
    Task(Box<ClaimedTask>),
    Nothing,
    /// The reason why no task should be claimed now.
    Obstacle(String),
}

impl<'a> Search<'a> {
    const fn new(store: &'a Store, options: &'a WorkerOptions) -> Self {
        Self { store, options, polled_at: None }
    }

    /// Polls and claims. A worker that has just had a task will probably get another one, so it
    /// claims without a poll.
    async fn next_task(&mut self) -> Result<SearchResult, StoreError> {
        if let Some(obstacle) = self.store.obstacle() {
            return Ok(SearchResult::Obstacle(obstacle));
        }
        let WorkerOptions { name, offers, lease, .. } = self.options;
        let polled_at = self.polled_at.take().filter(|at| at.elapsed() < KNOWN_FOR);
        let polled_at = match polled_at {
            Some(at) => at,
            None => {
                let poll = self.store.poll(name, offers).await?;
                if let Some(obstacle) =
                    other_version(poll.server_version).filter(|_| !self.options.any_version)
                {
                    return Ok(SearchResult::Obstacle(obstacle));
                }
                if !poll.is_any_claimable {
                    return Ok(SearchResult::Nothing);
                }
                Instant::now()
            }
        };
        let Some(task) = self.store.claim(name, offers, *lease).await? else {
            return Ok(SearchResult::Nothing);
        };
        self.polled_at = Some(polled_at);
        Ok(SearchResult::Task(Box::new(task)))
    }
}

/// The reason why a worker of this version should not work for the server.
fn other_version(server: Option<String>) -> Option<String> {
    const OWN: &str = env!("CARGO_PKG_VERSION");
    let version = server.filter(|version| version != OWN)?;
    Some(format!(
        "the server is torqued {version} and this worker is {OWN}, so results may differ; start a \
         worker of the server's version, or this one with --any-version"
    ))
}

/// Makes one attempt at a task, to its end.
///
/// # Errors
/// When the device failed: it must not be used again, whatever became of the task. When work does
/// not end although it was told to: the attempt has ended, and this process must end too.
async fn execute(
    store: &Store,
    device: &Device,
    task: ClaimedTask,
    options: &WorkerOptions,
    shutdown: &CancellationToken,
) -> Result<(), WorkerError> {
    options.log.begin(CurrentAttempt {
        job: task.job.0,
        task: task.label.clone(),
        epoch: task.fence.epoch.0,
    });
    log_task_start(&task, options);
    let held = HeldTask {
        store,
        fence: task.fence,
        job: task.job,
        label: task.label.clone(),
        time_limit: task.time_limit,
        log: &options.log,
    };
    let module = task.kind.parse().ok().and_then(module);
    let progress = Arc::new(ProgressCell::default());
    let stop = Arc::new(StopSignal::default());
    let attempt = Attempt {
        store: store.clone(),
        device: device.clone(),
        decoder: options.decoder.clone(),
        task,
        progress: Arc::clone(&progress),
        log: options.log.clone(),
        stop: Arc::clone(&stop),
        runtime: Handle::current(),
    };
    let over = CancellationToken::new();
    let work = async {
        let done = tokio::task::spawn_blocking(move || work(module, &attempt)).await;
        over.cancel();
        done.unwrap_or_else(|error| {
            Err(panicked(module, device.kind(), error.try_into_panic().ok().as_deref()))
        })
    };
    let lease = LeaseTerms { fence: held.fence, ttl: options.lease, time_limit: held.time_limit };
    let heartbeat = keep_alive(store, lease, &progress, &options.log, &stop, shutdown, &over);
    let ended = tokio::select! {
        (done, ()) = async { tokio::join!(work, heartbeat) } => {
            held.end(&done, stop.get()).await;
            match done {
                Err(error) if error.is_of_device() => {
                    Err(WorkerError::DeviceFailed { device: device.kind() })
                }
                _ => Ok(()),
            }
        }
        () = stop.overdue() => {
            Err(held.end_unstoppable(stop.get().unwrap_or(StopReason::Shutdown)).await)
        }
    };
    options.log.end();
    ended
}

/// Writes the first line of a log.
fn log_task_start(task: &ClaimedTask, options: &WorkerOptions) {
    tracing::info!(
        job = %task.job,
        kind = task.kind,
        task = %task.label,
        attempt = task.attempt,
        max_attempts = task.max_attempts,
        epoch = %task.fence.epoch,
        digest = %task.digest,
        version = env!("CARGO_PKG_VERSION"),
        worker = options.name,
        host = options.host,
        pid = std::process::id(),
        device = %options.device,
        threads = rayon::current_num_threads(),
        "begins"
    );
}

fn work(module: Option<KindModule>, attempt: &Attempt) -> Result<(), TaskError> {
    let unknown = || TaskError::UnknownKind { kind: attempt.task.kind.clone() };
    (module.ok_or_else(unknown)?.run)(attempt)
}

fn panicked(
    module: Option<KindModule>,
    device: DeviceKind,
    panic: Option<&(dyn Any + Send)>,
) -> TaskError {
    let message = panic.map_or("a panic without a message", spec::panic_message).to_owned();
    if module.is_some_and(|module| module.computes_models) && device.is_apart() {
        return TaskError::Device { device, message };
    }
    TaskError::Panicked(format!("a fault of torqued, please report it: {message}"))
}
