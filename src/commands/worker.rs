//! Workers, and the children that they start.

use std::io::Read;
use std::num::NonZero;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use recordings::DecoderProgram;
use reports::{Align, Table};
use tokio_util::sync::CancellationToken;
use worker::{AttemptLog, DeviceKind, Probed, WorkerError, WorkerOptions};

use crate::arguments::{DeviceArguments, StoreArguments, worker_name};
use crate::offers::OfferArguments;
use crate::process::{Interrupts, own_program};
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
        decoder: decoder()?,
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

/// The command that decodes a recording.
const DECODE_RECORDING: &str = "decode-recording";

#[derive(Debug, Args)]
pub struct DecodeArguments {
    /// The import's spec as JSON
    spec: String,
}

/// This program as a worker's child, which decodes a foreign file.
pub fn decoder() -> std::io::Result<DecoderProgram> {
    let program = own_program()?;
    Ok(DecoderProgram { program, arguments: vec![DECODE_RECORDING.to_owned()] })
}

pub fn decode_recording(arguments: &DecodeArguments) -> anyhow::Result<ExitCode> {
    recordings::decode_standard_input(&arguments.spec)?;
    Ok(ExitCode::SUCCESS)
}

#[derive(Debug, Args)]
pub struct DevicesArguments {
    /// Test only this device, and fail if it does not work
    #[arg(value_name = "NAME")]
    device: Option<DeviceKind>,

    /// Test it in this process, and print JSON
    #[arg(long, hide = true, requires = "device")]
    in_this_process: bool,
}

pub async fn devices(arguments: &DevicesArguments) -> anyhow::Result<ExitCode> {
    let mut table = Table::new([
        ("device", Align::Left),
        ("computed by", Align::Left),
        ("on", Align::Left),
        ("first result", Align::Right),
    ]);
    let row = |kind: DeviceKind, on: String, seconds: Option<f64>| {
        let seconds = seconds.map_or_else(String::new, |seconds| format!("{seconds:.2} s"));
        vec![kind.name().to_owned(), kind.backend().to_owned(), on, seconds]
    };
    match arguments.device {
        Some(kind) if arguments.in_this_process => {
            let probed = worker::try_device(kind)?;
            println!("{}", serde_json::to_string(&probed)?);
            return Ok(ExitCode::SUCCESS);
        }
        Some(kind) => {
            let probed = device::probe(kind).await?;
            table.push(row(kind, hardware(&probed), Some(probed.seconds)));
        }
        None => {
            for kind in DeviceKind::ALL {
                table.push(match kind.feature() {
                    Some(feature) if !kind.is_built() => {
                        row(kind, format!("not built in: --features {feature}"), None)
                    }
                    _ => match device::probe(kind).await {
                        Ok(probed) => row(kind, hardware(&probed), Some(probed.seconds)),
                        Err(error) => row(kind, error.to_string(), None),
                    },
                });
            }
        }
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}

/// The name of the hardware, as its driver gives it.
fn hardware(Probed { device, .. }: &Probed) -> String {
    match (&device.adapter, &device.driver) {
        (Some(adapter), Some(driver)) => format!("{adapter}, {driver}"),
        (Some(adapter), None) => adapter.clone(),
        (None, _) => "this processor".to_owned(),
    }
}
