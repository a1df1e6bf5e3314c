use std::io::Read;
use std::num::NonZero;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use tokio_util::sync::CancellationToken;
use worker::{AttemptLog, WorkerError, WorkerOptions};

use crate::arguments::{DeviceArguments, StoreArguments, worker_name};
use crate::commands::decode_recording;
use crate::offers::OfferArguments;
use crate::server::Interrupts;
use crate::{allocator, device, process};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    store: StoreArguments,

    /// Name shown beside its tasks [default: machine and process id]
    #[arg(long, value_name = "NAME", value_parser = worker_name)]
    name: Option<String>,

    /// Threads to compute with [default: the machine's]
    #[arg(long, env = "TORQUED_WORKER_THREADS", value_name = "N")]
    threads: Option<NonZero<usize>>,

    /// Seconds without a heartbeat after which another worker gets its task
    #[arg(long, env = "TORQUED_LEASE_SECONDS", value_name = "SECONDS", default_value_t = 15, value_parser = clap::value_parser!(u64).range(1..=3600))]
    lease_seconds: u64,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    offers: OfferArguments,
    /// Exit after this many seconds without a task [default: wait for ever]
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    idle_exit: Option<u64>,

    /// Also work for a server of another version; its results may differ
    #[arg(long)]
    any_version: bool,

    /// Stop when standard input closes, which happens when the server that started this worker dies
    #[arg(long)]
    stop_with_stdin: bool,
}

/// How long the process may take to end after its server died. It is longer than the time for its
/// task.
const STOP_WITHIN: Duration = Duration::from_secs(30);

pub async fn run(arguments: Arguments, log: &AttemptLog) -> anyhow::Result<ExitCode> {
    allocator::keep_freed_memory();
    process::open_many_files();
    process::prefer_as_oom_victim();
    let shutdown = CancellationToken::new();
    if arguments.stop_with_stdin {
        watch_stdin(shutdown.clone());
    }
    tokio::spawn(watch_signals(Interrupts::new()?, shutdown.clone()));
    let gpus = device::require(arguments.device.device).await?;
    let machine = || std::thread::available_parallelism().map_or(1, NonZero::get);
    let threads = arguments.threads.map(NonZero::get);
    let host = process::host();
    let options = WorkerOptions {
        location: arguments.store.location(),
        name: arguments.name.unwrap_or_else(|| format!("{host}-{}", std::process::id())),
        host,
        threads,
        offers: arguments.offers.complete(threads.unwrap_or_else(machine), gpus),
        lease: Duration::from_secs(arguments.lease_seconds),
        idle_exit: arguments.idle_exit.map(Duration::from_secs),
        any_version: arguments.any_version,
        device: arguments.device.device,
        decoder: decode_recording::program()?,
        log: log.clone(),
    };
    match worker::run(&options, shutdown).await {
        Ok(()) => Ok(ExitCode::SUCCESS),
        // The log has the reason.
        Err(WorkerError::Unstoppable { .. }) => {
            process::kill_children();
            Ok(ExitCode::from(executors::GAVE_UP))
        }
        Err(error) => Err(error.into()),
    }
}

/// A second Ctrl-C kills the process. A second SIGTERM does not: Slurm sends one when a worker has
/// to end soon, and one when its time is over.
async fn watch_signals(mut interrupts: Interrupts, shutdown: CancellationToken) {
    interrupts.next().await;
    shutdown.cancel();
    interrupts.next_from_terminal().await;
    std::process::exit(1);
}

/// Uses a thread of its own, because a read of standard input cannot be abandoned.
fn watch_stdin(shutdown: CancellationToken) {
    std::thread::spawn(move || {
        let mut stdin = std::io::stdin().lock();
        let mut byte = [0];
        while stdin.read(&mut byte).is_ok_and(|count| count > 0) {}
        shutdown.cancel();
        std::thread::sleep(STOP_WITHIN);
        tracing::error!("the worker did not stop in time; the lease of its task will expire");
        std::process::exit(1);
    });
}
