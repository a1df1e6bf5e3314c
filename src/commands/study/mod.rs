//! A study: runs its pipeline on a server of its own, and writes the report.
//!
//! The study is a pipeline preset and a reader of its results. It computes no number that is not in
//! a job's report, except means of those over seeds. Before it runs, `worker::rehearsal` does a
//! little of everything to predict the cost.

mod estimate;
mod gather;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use reports::study::{self, Plan};
use spec::{StudyEdition, StudyRecording, StudyScale, real_study};
use wire::{Job, JobState};

use crate::client::{Client, JobEnded, RecordedFile, Reuse, Submitted};
use crate::commands::serve::work_and_serve;
use crate::logging::Logging;
use crate::progress;
use crate::server::{Options, Server};

/// The question of the study.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Edition {
    /// The paper's question, on the paper's arms
    Paper,
    /// Arms as they are used: light damping, friction, unknown loads, a controller
    Real,
}

impl From<Edition> for StudyEdition {
    fn from(edition: Edition) -> Self {
        match edition {
            Edition::Paper => Self::Paper,
            Edition::Real => Self::Real,
        }
    }
}

/// The scale of the study.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Scale {
    /// Every kind of job, in twenty minutes on two cores; too small for conclusions
    Tiny,
    /// Tiny models, trained long enough to compare them, in some hours on two cores
    Small,
    /// The paper's sizes; only of the edition `paper`
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
    /// Question of the study
    #[arg(long, value_enum, default_value = "paper")]
    edition: Edition,

    /// Scale of the study
    #[arg(long, value_enum)]
    scale: Scale,

    /// A folder with recordings of real arms, which the models of the edition `real` are asked about, too; docs/study.md
    /// says which
    #[arg(long, value_name = "DIR")]
    recordings: Option<PathBuf>,

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
    let plan = Plan::of(arguments.edition.into(), arguments.scale.into())?;
    let recordings = match &arguments.recordings {
        Some(folder) => recordings(folder, plan.edition)?,
        None => Vec::new(),
    };
    if arguments.dry_run {
        let device = arguments.server.device.device;
        let estimate =
            tokio::task::spawn_blocking(move || estimate::estimate(&plan, device)).await??;
        print!("{estimate}");
        return Ok(ExitCode::SUCCESS);
    }
    study::check_replaceable(&arguments.out)?;
    let work =
        async |server: &Server| compute_and_write(&arguments, plan, &recordings, server).await;
    work_and_serve(&arguments.server, log, arguments.exit, work).await
}

/// A recording that is in the folder, with its file.
type Found = (&'static StudyRecording, PathBuf);

/// The recordings of an edition that `folder` has.
fn recordings(folder: &Path, edition: StudyEdition) -> anyhow::Result<Vec<Found>> {
    if edition != StudyEdition::Real {
        bail!("--recordings: only --edition real asks about recordings");
    }
    let all = real_study().recordings.iter();
    let of_folder = all.map(|recording| (recording, folder.join(&recording.file)));
    let (found, missing): (Vec<Found>, Vec<Found>) =
        of_folder.partition(|(_, file)| file.is_file());
    let names: Vec<&str> = missing.iter().map(|(recording, _)| recording.file.as_str()).collect();
    if found.is_empty() {
        bail!("--recordings {}: it has none of {}", folder.display(), names.join(", "));
    }
    for name in names {
        eprintln!("{} has no {name}, which the study leaves out", folder.display());
    }
    Ok(found)
}

/// Imports a recording, and gives its dataset.
async fn import(client: &Client, (recording, file): &Found) -> anyhow::Result<i64> {
    let submitted = client
        .import(
            &RecordedFile::named(std::slice::from_ref(file)),
            recording.import(),
            Reuse::ByDigest,
            &[],
        )
        .await;
    let Submitted { job, .. } = submitted.with_context(|| format!("{}", file.display()))?;
    let job = progress::follow(client, job.id).await?;
    match job.dataset.filter(|_| job.state == JobState::Succeeded) {
        Some(dataset) => Ok(dataset),
        None => Err(JobEnded::new(&job).into()),
    }
}

async fn compute_and_write(
    arguments: &Arguments,
    mut plan: Plan,
    recordings: &[Found],
    server: &Server,
) -> anyhow::Result<()> {
    let client = Client::new(&server.url, Some(server.own_token.clone()))?;
    let mut imported = Vec::new();
    for found in recordings {
        imported.push((found.0, import(&client, found).await?));
    }
    plan.add_recordings(&imported)?;
    let reuse = if arguments.force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let Submitted { job, existed } = client.submit(plan.request(), reuse).await?;
    let page = client.url(&format!("/jobs/{}", job.id));
    let verb = if existed { "continuing with " } else { "" };
    eprintln!("{verb}job {}: {page}", job.id);
    let job: Job = progress::follow(&client, job.id).await?;
    if job.state != JobState::Succeeded {
        return Err(JobEnded::new(&job).into());
    }
    let study = gather::gather(&client, &plan, &job).await?;
    study::write(&arguments.out, &study)?;
    println!("{}", arguments.out.join("README.md").display());
    Ok(())
}
