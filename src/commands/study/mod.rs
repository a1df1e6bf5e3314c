//! The paper's study: runs its pipeline on a server of its own, and writes the report.
//!
//! The study is a pipeline preset and a reader of its results. It computes no number that is not in
//! a job's report, except means of those over seeds. Before it runs, `worker::rehearsal` does a
//! little of everything to predict the cost.

mod estimate;
mod gather;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use reports::study::{self, Plan};
use spec::StudyScale;
use wire::{Job, JobState};

use crate::client::{Client, JobEnded, Reuse, Submitted};
use crate::commands::serve::work_and_serve;
use crate::logging::Logging;
use crate::progress;
use crate::server::{Options, Server};

/// The scale of the study.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Scale {
    /// Every kind of job, in twenty minutes on two cores; too small for conclusions
    Tiny,
    /// Tiny models, trained long enough to compare them, in some hours on two cores
    Small,
    /// The paper's sizes
    Paper,
}

impl From<Scale> for StudyScale {
    fn from(scale: Scale) -> Self {
        match scale {
            Scale::Tiny => Self::Tiny,
            Scale::Small => Self::Small,
            Scale::Paper => Self::Paper,
        }
    }
}

#[derive(Debug, Args)]
pub struct Arguments {
    /// Scale of the study
    #[arg(long, value_enum)]
    scale: Scale,

    /// Folder for the report; an older report is replaced
    #[arg(long, value_name = "DIR", default_value = "report")]
    out: PathBuf,

    /// Only estimate time, memory and disk space, by doing a little of everything
    #[arg(long)]
    dry_run: bool,

    /// Exit after writing the report, instead of serving until Ctrl-C
    #[arg(long)]
    exit: bool,

    /// Compute everything again, even what was done before
    #[arg(long)]
    force: bool,

    #[command(flatten)]
    server: Options,
}

pub async fn run(arguments: Arguments, log: &Logging) -> anyhow::Result<ExitCode> {
    let plan = Plan::of(arguments.scale.into())?;
    if arguments.dry_run {
        let device = arguments.server.device.device;
        let estimate =
            tokio::task::spawn_blocking(move || estimate::estimate(&plan, device)).await??;
        print!("{estimate}");
        return Ok(ExitCode::SUCCESS);
    }
    study::check_replaceable(&arguments.out)?;
    let work = async |server: &Server| compute_and_write(&arguments, &plan, server).await;
    work_and_serve(&arguments.server, log, arguments.exit, work).await
}

async fn compute_and_write(
    arguments: &Arguments,
    plan: &Plan,
    server: &Server,
) -> anyhow::Result<()> {
    let client = Client::new(&server.url, Some(server.own_token.clone()))?;
    let reuse = if arguments.force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let Submitted { job, existed } = client.submit(Plan::request(plan.scale), reuse).await?;
    let page = client.url(&format!("/jobs/{}", job.id));
    let verb = if existed { "continuing with " } else { "" };
    eprintln!("{verb}job {}: {page}", job.id);
    let job: Job = progress::follow(&client, job.id).await?;
    if job.state != JobState::Succeeded {
        return Err(JobEnded::new(&job).into());
    }
    let study = gather::gather(&client, plan, &job).await?;
    study::write(&arguments.out, &study)?;
    println!("{}", arguments.out.join("README.md").display());
    Ok(())
}
