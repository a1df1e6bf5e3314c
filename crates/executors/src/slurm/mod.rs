//! Slurm, through its commands. Every release has them, and they find the cluster by themselves.
//!
//! A worker is a job. Its name says which store it belongs to, and its comment says what it offers.

mod listing;
mod program;
mod script;

use std::path::PathBuf;
use std::time::Duration;

use crate::worker_command::prefix;
use crate::{Ask, End, EngineError, Phase, PlacedWorker, WorkerCommand};
use program::Program;

/// Requests workers of one store from Slurm.
#[derive(Debug)]
pub struct Slurm {
    /// The store's identity.
    pub store: String,
    /// The command that a node runs, and its environment.
    pub command: WorkerCommand,
    /// Options that the operator adds to `sbatch`, such as `--partition=lab`.
    pub options: Vec<String>,
    /// Folder for the output of workers, which nodes and server can reach. Without it the output is
    /// lost.
    pub logs: Option<PathBuf>,
}

/// How long before its time limit a worker is told to end. A checkpoint of a large model takes
/// seconds.
const NOTICE: Duration = Duration::from_secs(60);

impl Slurm {
    pub(crate) async fn workers(&self) -> Result<Vec<PlacedWorker>, EngineError> {
        let squeue = Program::new("squeue").args(["--me", "--noheader", "--states=all"]);
        let printed = squeue.arg(listing::FORMAT).run(Vec::new()).await?;
        let workers = listing::workers(&printed, &prefix(&self.store))?;
        // By default Slurm tells a job of its preemption only after the partition's grace time,
        // unless the cluster has `preempt_send_user_signal`. Telling the worker now gives it the
        // grace time too, and telling it twice does no harm.
        for worker in &workers {
            if worker.phase == Phase::Ending(Some(listing::PREEMPTED.to_owned())) {
                signal(&worker.identifier).await?;
            }
        }
        Ok(workers)
    }

    /// Requests a worker. Two jobs with one name would be two workers, so check with
    /// [`Slurm::workers`] whether a request without an answer has arrived.
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
            // Slurm counts in units of 2^20 bytes.
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
        // The last option wins. So the operator's options override these, and the options by which
        // workers are found override all.
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
        // The output is `NUMBER` or `NUMBER;CLUSTER`.
        let number = printed.trim().split(';').next().unwrap_or_default();
        if number.is_empty() || !number.bytes().all(|byte| byte.is_ascii_digit()) {
            return Err(EngineError::Unreadable { program: "sbatch", line: printed });
        }
        Ok(number.to_owned())
    }

    /// Cancels a waiting job. A running job only gets the signal, because its worker decides when
    /// it has given its task back.
    pub(crate) async fn let_go(&self, number: &str) -> Result<(), EngineError> {
        scancel(&["--state=PENDING", number]).await?;
        signal(number).await
    }

    /// Asks Slurm's accounting, which not every cluster has.
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

/// Tells a running worker to give its task back and end.
async fn signal(number: &str) -> Result<(), EngineError> {
    scancel(&["--state=RUNNING", "--batch", "--signal=TERM", number]).await
}

/// Runs `scancel`. A job that has ended meanwhile is no error.
async fn scancel(arguments: &[&str]) -> Result<(), EngineError> {
    match Program::new("scancel").args(arguments).run(Vec::new()).await {
        Err(EngineError::ProgramFailed { message, .. }) if message.contains("Invalid job id") => {
            Ok(())
        }
        answer => answer.map(|_| ()),
    }
}
