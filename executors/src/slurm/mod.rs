//! Slurm, through its commands: every release has them, and they find the cluster as they do for anybody.
//!
//! A worker is a job. Its name says whose it is, its comment what it offers.

mod listing;
mod program;
mod script;

use std::path::PathBuf;
use std::time::Duration;

use crate::worker_command::prefix;
use crate::{Ask, End, EngineError, Phase, PlacedWorker, WorkerCommand};
use program::Program;

/// Asks Slurm for workers of one store.
#[derive(Debug)]
pub struct Slurm {
    /// The store's name among others.
    pub store: String,
    pub command: WorkerCommand,
    /// Options of `sbatch` that the operator adds, such as `--partition=lab`.
    pub options: Vec<String>,
    /// Folder that nodes and server see, for what workers print; without one it is lost.
    pub logs: Option<PathBuf>,
}

/// How long before the end of its time a worker is told. A checkpoint of a large model takes seconds.
const NOTICE: Duration = Duration::from_secs(60);

impl Slurm {
    pub(crate) async fn workers(&self) -> Result<Vec<PlacedWorker>, EngineError> {
        let squeue = Program::new("squeue").args(["--me", "--noheader", "--states=all"]);
        let printed = squeue.arg(listing::FORMAT).run(Vec::new()).await?;
        let workers = listing::workers(&printed, &prefix(&self.store))?;
        // Slurm itself tells a job of its preemption when the partition's grace is over, unless the cluster has
        // `preempt_send_user_signal`. Told now, the worker has the grace, too; told twice, it does not mind.
        for worker in &workers {
            if worker.phase == Phase::Ending(Some(listing::PREEMPTED.to_owned())) {
                signal(&worker.identifier).await?;
            }
        }
        Ok(workers)
    }

    /// Two jobs of one name would be two workers; who asks knows after [`Slurm::workers`] whether a request that went
    /// astray has arrived.
    pub(crate) async fn ask(&self, ask: &Ask) -> Result<String, EngineError> {
        let Ask { name, resources, stays } = ask;
        let output = match &self.logs {
            Some(folder) => folder.join(format!("{name}.log")),
            None => PathBuf::from("/dev/null"),
        };
        let mut sbatch = Program::new("sbatch").args([
            "--nodes=1".to_owned(),
            "--ntasks=1".to_owned(),
            format!("--cpus-per-task={}", resources.cpus.unwrap_or(1)),
            format!("--signal=B:TERM@{}", NOTICE.as_secs()),
            "--chdir=/".to_owned(),
            format!("--output={}", output.display()),
            format!("--export={}", script::variables(&self.command)),
        ]);
        if resources.megabytes() > 0 {
            // Slurm counts in 2^20 bytes.
            let mebibytes = (u64::from(resources.megabytes()) * 1_000_000).div_ceil(1 << 20);
            sbatch = sbatch.arg(format!("--mem={mebibytes}M"));
        }
        if resources.gpus > 0 {
            sbatch = sbatch.arg(format!("--gres=gpu:{}", resources.gpus));
        }
        if !resources.tags.is_empty() {
            let tags: Vec<&str> = resources.tags.iter().map(String::as_str).collect();
            sbatch = sbatch.arg(format!("--constraint={}", tags.join("&")));
        }
        // The last option wins: the operator's over these, and those that find workers again over all.
        let printed = sbatch
            .args(&self.options)
            .args([
                "--parsable".to_owned(),
                "--no-requeue".to_owned(),
                format!("--job-name={name}"),
                format!("--comment={}", listing::comment(resources, *stays)),
            ])
            .envs(&self.command.environment)
            .run(script::of(&self.command, ask))
            .await?;
        // `NUMBER` or `NUMBER;CLUSTER`.
        let number = printed.trim().split(';').next().unwrap_or_default();
        if number.is_empty() || !number.bytes().all(|byte| byte.is_ascii_digit()) {
            return Err(EngineError::Unreadable { program: "sbatch", line: printed });
        }
        Ok(number.to_owned())
    }

    /// A job that waits is cancelled. To one that runs goes the signal alone: when its worker has put its task down is
    /// for the worker to say.
    pub(crate) async fn let_go(&self, number: &str) -> Result<(), EngineError> {
        scancel(&["--state=PENDING", number]).await?;
        signal(number).await
    }

    /// From Slurm's accounting, which not every cluster has.
    pub(crate) async fn remembers(&self, name: &str) -> Option<End> {
        let sacct = Program::new("sacct").args([
            "--noheader",
            "--parsable2",
            "--allocations",
            "--starttime=now-7days",
            "--format=State,ExitCode",
            &format!("--name={name}"),
        ]);
        let printed = sacct.run(Vec::new()).await.ok()?;
        listing::remembered(&printed)
    }
}

/// Has a running worker put its task down and end.
async fn signal(number: &str) -> Result<(), EngineError> {
    scancel(&["--state=RUNNING", "--batch", "--signal=TERM", number]).await
}

/// A job that has ended meanwhile needs no more.
async fn scancel(arguments: &[&str]) -> Result<(), EngineError> {
    match Program::new("scancel").args(arguments).run(Vec::new()).await {
        Err(EngineError::ProgramFailed { message, .. }) if message.contains("Invalid job id") => {
            Ok(())
        }
        answer => answer.map(|_| ()),
    }
}
