//! Chooses the executor that runs the workers, from the command line.

use std::num::NonZero;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};
use executors::{Bounds, Engine, Kubernetes, Settings, Slurm, WorkerCommand};
use store::Store;
use worker::DeviceKind;

use crate::arguments::StoreArguments;
use crate::logging::{LOG_FORMAT, Logging};
use crate::process;

use super::Options;

/// Flags of `serve` for the place where its workers run.
#[derive(Debug, Args)]
pub struct ExecutorArguments {
    /// Where workers run: as child processes of this server, or on a cluster, which places them
    /// while tasks wait
    #[arg(long, env = "TORQUED_EXECUTOR", value_enum, value_name = "NAME", default_value_t)]
    pub executor: Executor,

    /// Workers that a cluster keeps even while nothing waits, 0 to 1000
    #[arg(long, env = "TORQUED_MIN_WORKERS", value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub min_workers: u16,

    /// Largest number of workers on a cluster, 1 to 1000
    #[arg(long, env = "TORQUED_MAX_WORKERS", value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub max_workers: u16,

    /// Seconds after which a cluster's worker exits if it finds no task
    #[arg(long, env = "TORQUED_IDLE_EXIT", value_name = "SECONDS", default_value_t = 300, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub idle_exit: u64,

    /// Device of a cluster's workers with GPUs [default: cuda or gpu if this program has it,
    /// otherwise cpu]
    #[arg(long, env = "TORQUED_GPU_DEVICE", value_name = "NAME")]
    pub gpu_device: Option<DeviceKind>,

    /// Seconds between two looks at the cluster
    #[arg(long, env = "TORQUED_LOOK_EVERY", value_name = "SECONDS", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=300))]
    pub look_every: u64,

    /// Program that Slurm's nodes run [default: this one, at the same path]
    #[arg(long, env = "TORQUED_WORKER_PROGRAM", value_name = "FILE")]
    pub worker_program: Option<PathBuf>,

    /// sbatch option for every worker, such as `--partition=lab`; may be given several times
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub slurm_option: Vec<String>,

    /// Manifest of a Kubernetes Job, which is the template of the workers' Jobs
    #[arg(long, env = "TORQUED_KUBERNETES_JOB", value_name = "FILE")]
    pub kubernetes_job: Option<PathBuf>,
}

/// The executor of the workers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Executor {
    /// This server, as child processes
    #[default]
    Local,
    /// Slurm, through sbatch, squeue and scancel
    Slurm,
    /// Kubernetes, as Jobs
    Kubernetes,
}

/// Default number of threads of a cluster's worker.
const THREADS: u32 = 4;

/// Prefixes of the server's environment variables that a remote worker needs. They hold the
/// settings of the object store, and the parts of the connection that a PostgreSQL URL leaves out.
/// Keys and passwords are among them.
const PASSED_ON: [&str; 3] = ["AWS_", "TORQUED_S3_", "PG"];

/// Further such variables by their full names.
const PASSED_ON_BY_NAME: [&str; 2] = ["TORQUED_CACHE_BYTES", "TORQUED_INSTRUCTIONS"];

impl ExecutorArguments {
    /// Whether this server runs its workers.
    pub fn is_local(&self) -> bool {
        self.executor == Executor::Local
    }

    /// The engine to request workers from, with its options. `None` if this server runs them
    /// itself.
    ///
    /// # Errors
    /// When the arguments contradict each other, or the engine cannot be reached from here.
    pub async fn engine(
        &self,
        options: &Options,
        command: WorkerCommand,
        store: &Store,
    ) -> anyhow::Result<Option<(Engine, Settings)>> {
        ensure!(
            self.min_workers <= self.max_workers,
            "--min-workers {} is more than --max-workers {}",
            self.min_workers,
            self.max_workers
        );
        let engine = match self.executor {
            Executor::Local => return Ok(None),
            Executor::Slurm => {
                need_postgresql(&options.store, "slurm")?;
                Engine::Slurm(self.slurm(options, command, store.identity().await?)?)
            }
            Executor::Kubernetes => {
                need_postgresql(&options.store, "kubernetes")?;
                let kubernetes = self.kubernetes(command, store.identity().await?).await?;
                Engine::Kubernetes(Box::new(kubernetes))
            }
        };
        let threads = options.worker_threads.map(NonZero::get);
        let threads = threads.map(u32::try_from).transpose().context("--worker-threads")?;
        let settings = Settings {
            bounds: Bounds { min: self.min_workers.into(), max: self.max_workers.into() },
            usual: options.offers.of_a_clusters_worker(threads.unwrap_or(THREADS)),
            look_every: Duration::from_secs(self.look_every),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        Ok(Some((engine, settings)))
    }

    fn slurm(
        &self,
        options: &Options,
        command: WorkerCommand,
        store: String,
    ) -> anyhow::Result<Slurm> {
        let program = match &self.worker_program {
            Some(program) => program.clone(),
            None => std::env::current_exe().context("cannot find the path of this program")?,
        };
        let folder = &options.store.data;
        let folder = folder.canonicalize().context("cannot find the path of the data folder")?;
        // With objects in a bucket, every machine has a data folder of its own.
        let logs = options.store.objects.is_none().then(|| folder.join("workers"));
        if let Some(logs) = &logs {
            std::fs::create_dir_all(logs)
                .with_context(|| format!("cannot create {}", logs.display()))?;
        }
        let is_passed_on = |name: &str| {
            PASSED_ON.iter().any(|prefix| name.starts_with(prefix))
                || PASSED_ON_BY_NAME.contains(&name)
        };
        let passed_on = std::env::vars_os()
            .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)))
            .filter(|(name, _)| is_passed_on(name));
        let environment = command.environment.iter().cloned().chain(passed_on).collect();
        let store_flags = vec!["--data".into(), folder.into()];
        let command = WorkerCommand { program, store: store_flags, environment, ..command };
        Ok(Slurm { store, command, options: self.slurm_option.clone(), logs })
    }

    async fn kubernetes(
        &self,
        command: WorkerCommand,
        store: String,
    ) -> anyhow::Result<Kubernetes> {
        let file = self.kubernetes_job.as_ref().context(
            "--executor kubernetes needs --kubernetes-job FILE; begin with \
             deploy/kubernetes/worker.yaml",
        )?;
        let manifest = std::fs::read_to_string(file)
            .with_context(|| format!("cannot read {}", file.display()))?;
        // Secrets come to a Pod only through the template, because anybody who may read Jobs can
        // read everything in them.
        let environment = command.environment.iter().filter(|(name, _)| name != DATABASE);
        let command = WorkerCommand { environment: environment.cloned().collect(), ..command };
        Kubernetes::connect(store, command, &manifest)
            .await
            .with_context(|| format!("--kubernetes-job {}", file.display()))
    }
}

fn need_postgresql(store: &StoreArguments, executor: &str) -> anyhow::Result<()> {
    ensure!(
        store.database.is_some(),
        "--executor {executor} needs --database postgres://...: its workers run on other machines, \
         and SQLite works on one machine only"
    );
    Ok(())
}

/// The command that starts workers on this machine.
///
/// # Errors
/// When the operating system does not provide this program's path.
pub fn worker_command(options: &Options, log: &Logging) -> anyhow::Result<WorkerCommand> {
    let own = options.device.device;
    let is_elsewhere = options.executor.executor != Executor::Local;
    let device = if is_elsewhere && own.is_apart() { DeviceKind::Cpu } else { own };
    // Training reuses the same large tensors at every step. Keeping their pages instead of
    // returning them after 10 ms made 150 steps of the quickstart take 4.5 s instead of 5.6 s.
    let mut environment = vec![("MIMALLOC_PURGE_DELAY".to_owned(), "-1".to_owned())];
    environment.push((LOG_FORMAT.to_owned(), log.format.as_str().to_owned()));
    environment.extend(urls(&options.store));
    Ok(WorkerCommand {
        program: process::own_program().context("cannot find the path of this program")?,
        store: vec!["--data".into(), options.store.data.clone().into()],
        device: device.name().to_owned(),
        gpu_device: options.executor.gpu_device.unwrap_or_else(gpu_device).name().to_owned(),
        lease_seconds: options.lease_seconds,
        log: log.filter.clone(),
        idle_exit: Duration::from_secs(options.executor.idle_exit),
        environment,
    })
}

const DATABASE: &str = "TORQUED_DATABASE";
const OBJECTS: &str = "TORQUED_OBJECTS";

/// The locations of database and objects, as environment variables. They contain passwords, and
/// other users can see the arguments of a process.
fn urls(store: &StoreArguments) -> impl Iterator<Item = (String, String)> {
    let database = store.database.as_ref().map(|url| (DATABASE, url.expose().to_owned()));
    let objects = store.objects.as_ref().map(|url| (OBJECTS, url.to_string()));
    database.into_iter().chain(objects).map(|(name, value)| (name.to_owned(), value))
}

/// The GPU that this program was built for.
fn gpu_device() -> DeviceKind {
    let built = [DeviceKind::Cuda, DeviceKind::Gpu].into_iter().find(|kind| kind.is_built());
    built.unwrap_or(DeviceKind::Cpu)
}
