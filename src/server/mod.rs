//! A server: store, HTTP, reaper and executor, which are started and stopped together.
//!
//! It has no other work: it answers HTTP, computes live predictions, reaps leases, sweeps orphans,
//! and has an executor run the workers.

mod executor;
mod housekeeping;
mod listen;
mod places;

use std::num::NonZero;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, ensure};
use api::App;
use clap::Args;
use executors::{Autoscaler, WorkerProcesses};
use live::Live;
use spec::{DataSpec, JobKind, TrainSpec};
use store::{Access, Location, Store};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::arguments::{DeviceArguments, RetentionArguments, StoreArguments, days_long};
use crate::logging::Logging;
use crate::offers::WorkerOfferArguments;
use crate::process::Interrupts;
use crate::{allocator, device, process};
use executor::ExecutorArguments;
use listen::{Bound, SocketFile};

/// Options of the server for `serve` and `quickstart`.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    pub store: StoreArguments,

    /// Make a new store although its place has other files, or go on without the files that the
    /// database names although store.json is missing beside them; look at the place first
    #[arg(long)]
    claim_place: bool,

    /// Address to listen on, or unix:PATH for a socket that only you can open [default:
    /// 127.0.0.1:7070, or the next free port]
    #[arg(long, env = "TORQUED_LISTEN", value_name = "ADDRESS:PORT")]
    pub listen: Option<listen::Address>,

    /// Number of worker processes on this machine, 0 to 64; there are none if --executor is a
    /// cluster
    #[arg(long, env = "TORQUED_WORKERS", value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(0..=64))]
    pub workers: u16,

    /// Threads of each worker [default: the machine's threads divided by the number of workers; 4
    /// on a cluster]
    #[arg(long, env = "TORQUED_WORKER_THREADS", value_name = "N")]
    pub worker_threads: Option<NonZero<usize>>,

    #[command(flatten)]
    pub offers: WorkerOfferArguments,

    #[command(flatten)]
    pub executor: ExecutorArguments,

    #[command(flatten)]
    pub device: DeviceArguments,

    /// Threads that compute one live prediction [default: the machine's]
    #[arg(long, env = "TORQUED_PREDICTION_THREADS", value_name = "N")]
    pub prediction_threads: Option<NonZero<usize>>,

    /// Limit of the models' weights that are kept loaded for live predictions, in bytes
    #[arg(long, env = "TORQUED_MAX_LOADED_BYTES", value_name = "N", default_value_t = live::LOADED_BYTES, value_parser = clap::value_parser!(u64).range(1..))]
    pub max_loaded_bytes: u64,

    /// Seconds without a heartbeat after which another worker gets a task
    #[arg(long, env = "TORQUED_LEASE_SECONDS", value_name = "SECONDS", default_value_t = 15, value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub lease_seconds: u64,

    /// A token of scope admin with at least 16 characters, in addition to those from `torqued token
    /// create`; a token is required if other machines can connect
    #[arg(long, env = "TORQUED_TOKEN", value_name = "TOKEN", hide_env_values = true)]
    token: Option<String>,

    /// Largest number of open connections, 16 to 100000; it is lower if the system allows this
    /// process fewer than two files per connection
    #[arg(long, env = "TORQUED_MAX_CONNECTIONS", value_name = "N", default_value_t = api::limits::CONNECTIONS, value_parser = connections)]
    pub max_connections: usize,

    /// Requests per second from one address, 1 to 1000000; ten times as many may come at once
    #[arg(long, env = "TORQUED_MAX_REQUESTS_PER_SECOND", value_name = "N", default_value_t = api::Options::default().requests_per_second)]
    pub max_requests_per_second: NonZero<u32>,

    /// Failed logins and wrong tokens per minute from one address, and at once
    #[arg(long, env = "TORQUED_MAX_FAILED_LOGINS_PER_MINUTE", value_name = "N", default_value_t = api::Options::default().failed_logins_per_minute)]
    pub max_failed_logins_per_minute: NonZero<u32>,

    /// A proxy that names its clients in X-Forwarded-For: an address, a network such as
    /// 10.0.0.0/24, or `unix` for the clients of the server's socket; may be given several times
    #[arg(
        long = "trusted-proxy",
        env = "TORQUED_TRUSTED_PROXIES",
        value_name = "ADDRESS",
        value_delimiter = ','
    )]
    pub trusted_proxies: Vec<api::TrustedProxy>,

    /// Largest simulation that can be submitted, in trajectories
    #[arg(long, env = "TORQUED_MAX_TRAJECTORIES", value_name = "N", default_value_t = api::limits::MAX_TRAJECTORIES, value_parser = clap::value_parser!(u64).range(1..=spec::MAX_TRAJECTORIES))]
    pub max_trajectories: u64,

    /// Time limit of an attempt at a task in seconds, for one kind of job: the largest that jobs
    /// may ask for, and the default; may be given several times
    #[arg(long = "time-limit", env = "TORQUED_TIME_LIMITS", value_name = "KIND=SECONDS", value_delimiter = ',', value_parser = time_limit)]
    pub time_limits: Vec<(JobKind, u32)>,

    /// Largest file that can be sent for an import, in bytes
    #[arg(long, env = "TORQUED_MAX_UPLOAD_BYTES", value_name = "N", default_value_t = api::limits::MAX_UPLOAD_BYTES, value_parser = clap::value_parser!(u64).range(1..))]
    pub max_upload_bytes: u64,

    /// Limit of all sent files together in bytes, including those in the trash [default: no limit]
    #[arg(long, env = "TORQUED_UPLOAD_QUOTA_BYTES", value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub upload_quota_bytes: Option<u64>,

    /// Days for which deleted things can be restored, 0 to 3650
    #[arg(long, env = "TORQUED_TRASH_DAYS", value_name = "DAYS", default_value_t = api::limits::TRASH_DAYS, value_parser = clap::value_parser!(u16).range(0..=3650))]
    pub trash_days: u16,

    #[command(flatten)]
    pub retention: RetentionArguments,
}

impl Options {
    /// The token that requests must carry. An empty token means none.
    pub fn token(&self) -> Option<&str> {
        self.token.as_deref().filter(|token| !token.is_empty())
    }

    /// Refuses a token that can be guessed, or that no header can carry. This is also needed on
    /// loopback, because a proxy may listen for the network there.
    fn check_token(&self) -> anyhow::Result<()> {
        let Some(token) = self.token() else { return Ok(()) };
        ensure!(
            api::is_hard_to_guess(token),
            "the server's token has a length of {}, allowed: at least {} characters of printable ASCII, \
             no space at the ends; make one with `openssl rand -base64 24`, or leave --token and \
             TORQUED_TOKEN out and use `torqued token create NAME --scope admin --directly`",
            token.chars().count(),
            api::limits::TOKEN_CHARACTERS
        );
        Ok(())
    }
}

/// How long open requests may take when the server stops.
const FINISH_REQUESTS_WITHIN: Duration = Duration::from_secs(3);

/// A running server.
pub struct Server {
    /// The address, e.g. `http://127.0.0.1:7070` or `unix:/run/torqued`.
    pub url: String,
    /// The token for requests of this process to its own server.
    pub own_token: String,
    data: PathBuf,
    store: Store,
    workers: TaskTracker,
    stop_workers: CancellationToken,
    kill_workers: CancellationToken,
    http: tokio::task::JoinHandle<Result<(), api::ServeError>>,
    stop_http: CancellationToken,
    app: App,
    _socket: Option<SocketFile>,
}

impl Server {
    /// # Errors
    /// When the device or the folder cannot be used, or listening on the address fails.
    pub async fn start(options: &Options, log: &Logging) -> anyhow::Result<Self> {
        allocator::keep_freed_memory();
        options.check_token()?;
        process::open_many_files();
        let own_workers = if options.executor.is_local() { options.workers } else { 0 };
        let connections = process::files_allow(options.max_connections, own_workers)?;
        device::require(options.device.device).await?;
        let location = Location { claimed: options.claim_place, ..options.store.location() };
        let store = Store::open_at(&location, Access::Server).await?;
        let has_token = options.token().is_some() || !store.tokens().await?.is_empty();
        listen::refuse_unguarded(options.listen.as_ref(), has_token)?;
        store.register_server(env!("CARGO_PKG_VERSION")).await?;
        let command = executor::worker_command(options, log)?;
        let engine = options.executor.engine(options, command.clone(), &store).await?;
        let Bound { listener, url, file } = listen::bind(options.listen.as_ref()).await?;

        let stop_http = CancellationToken::new();
        let own_token = api::new_token().context("the system gives no random bits")?;
        let app = App::new(
            store.clone(),
            &api::Options {
                token: options.token().map(str::to_owned),
                own_token: Some(own_token.clone()),
                connections,
                requests_per_second: options.max_requests_per_second,
                failed_logins_per_minute: options.max_failed_logins_per_minute,
                trusted_proxies: options.trusted_proxies.clone(),
                max_trajectories: options.max_trajectories,
                time_limits_s: options.time_limits.iter().copied().collect(),
                max_upload_bytes: options.max_upload_bytes,
                upload_quota_bytes: options.upload_quota_bytes,
                keep_deleted: days_long(options.trash_days),
                ..api::Options::default()
            },
        )
        .with_models(Arc::new(live(store.clone(), options)?));
        let app = match process::memory_bytes() {
            Some(bytes) => {
                app.with_memory_doubts(Arc::new(move |training: &TrainSpec, data: &DataSpec| {
                    models::memory_doubt(training, data, bytes)
                }))
            }
            None => app,
        };
        let http =
            tokio::spawn(api::serve(listener, app.clone(), stop_http.clone().cancelled_owned()));

        let workers = TaskTracker::new();
        let stop_workers = CancellationToken::new();
        let kill_workers = CancellationToken::new();
        workers.spawn(housekeeping::reap(store.clone(), stop_workers.clone()));
        let keeping = housekeeping::Keeping {
            retention: options.retention.retention(),
            trash: days_long(options.trash_days),
        };
        workers.spawn(housekeeping::sweep(store.clone(), keeping, stop_workers.clone()));
        workers.spawn(housekeeping::forget_events(store.clone(), stop_workers.clone()));
        if let Some((engine, settings)) = engine {
            let autoscaler = Autoscaler::new(store.clone(), engine, settings).await?;
            workers.spawn(autoscaler.run(stop_workers.clone()));
        } else {
            housekeeping::forget_engine(&store).await?;
            workers.spawn(housekeeping::forget_engines(store.clone(), stop_workers.clone()));
            let count = usize::from(options.workers);
            WorkerProcesses {
                store: store.clone(),
                command,
                count,
                name: names_of_workers(options),
                threads: worker_threads(options),
                offers: options.offers.flags(count),
            }
            .spawn(&workers, &stop_workers, &kill_workers);
        }
        workers.close();

        let data = options.store.data.clone();
        Ok(Self {
            url,
            own_token,
            data,
            store,
            workers,
            stop_workers,
            kill_workers,
            http,
            stop_http,
            app,
            _socket: file,
        })
    }

    /// Serves until the first interrupt, and then stops. The second interrupt kills the process.
    pub async fn run_until_interrupted(
        mut self,
        interrupts: &mut Interrupts,
    ) -> anyhow::Result<()> {
        tokio::select! {
            () = interrupts.next() => {}
            ended = &mut self.http => {
                self.stop(interrupts).await;
                ended.context("the server panicked")??;
                return Ok(());
            }
        }
        self.stop(interrupts).await;
        Ok(())
    }

    /// Claims no more tasks, lets workers give theirs back, and finishes requests.
    pub async fn stop(self, interrupts: &mut Interrupts) {
        tracing::info!("stopping; interrupt again to kill");
        self.app.announce_end();
        self.stop_workers.cancel();
        tokio::select! {
            () = self.workers.wait() => {}
            () = interrupts.next() => {
                self.kill_workers.cancel();
                self.workers.wait().await;
            }
        }
        self.stop_http.cancel();
        if !self.http.is_finished() {
            let _ = tokio::time::timeout(FINISH_REQUESTS_WITHIN, self.http).await;
        }
        self.store.close().await;
    }
}

/// The part that computes live predictions.
fn live(store: Store, options: &Options) -> anyhow::Result<Live> {
    let machine = || std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN);
    let options = live::Options {
        device: options.device.device,
        threads: options.prediction_threads.unwrap_or_else(machine),
        loaded_bytes: options.max_loaded_bytes,
    };
    Live::new(store, options).context("cannot start threads for predictions")
}

fn connections(text: &str) -> Result<usize, String> {
    const ALLOWED: std::ops::RangeInclusive<usize> = 16..=100_000;
    let number = text.parse().ok().filter(|number| ALLOWED.contains(number));
    number.ok_or(format!("allowed: {} to {}", ALLOWED.start(), ALLOWED.end()))
}

/// Reads a time limit, e.g. `train=3600`.
fn time_limit(text: &str) -> Result<(JobKind, u32), String> {
    const LONGEST: u32 = 30 * 24 * 60 * 60;
    let (kind, seconds) = text.split_once('=').ok_or("expected KIND=SECONDS, e.g. train=86400")?;
    let kind: JobKind = kind.parse().map_err(|error: spec::SpecError| error.to_string())?;
    let seconds = seconds.parse().ok().filter(|seconds| (1..=LONGEST).contains(seconds));
    Ok((kind, seconds.ok_or(format!("allowed: 1 to {LONGEST} seconds"))?))
}

/// The prefix of the names of this server's workers. Servers that share a database have workers
/// with the same index.
fn names_of_workers(options: &Options) -> String {
    if options.store.database.is_none() {
        return "worker-".to_owned();
    }
    format!("{}-{}-worker-", process::host(), std::process::id())
}

fn worker_threads(options: &Options) -> u32 {
    let machine = || std::thread::available_parallelism().map_or(1, NonZero::get);
    let threads = match options.worker_threads {
        Some(threads) => threads.get(),
        None => (machine() / usize::from(options.workers).max(1)).max(1),
    };
    u32::try_from(threads).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_limit_names_a_kind_and_its_seconds() {
        assert_eq!(time_limit("train=3600"), Ok((JobKind::Train, 3600)));
        for wrong in ["train", "train=", "train=0", "train=1h", "trian=60", "train=2592001"] {
            assert!(time_limit(wrong).is_err(), "{wrong}");
        }
    }
}
