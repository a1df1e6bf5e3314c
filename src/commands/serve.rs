//! Commands with a server of their own.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use reports::{Align, Table};
use wire::{Job, JobState};

use crate::client::{Client, JobEnded, Reuse, Submitted};
use crate::exit::INTERRUPTED;
use crate::logging::Logging;
use crate::process::Interrupts;
use crate::progress;
use crate::server::{Options, Server};

#[derive(Debug, Args)]
pub struct Arguments {
    /// TOML file with these flags as keys, such as `max_connections = 64`; flags and environment
    /// variables take precedence
    #[arg(long, env = "TORQUED_CONFIG", value_name = "FILE")]
    pub config: Option<PathBuf>,

    #[command(flatten)]
    server: Options,
}

pub async fn run(arguments: Arguments, log: &Logging) -> anyhow::Result<ExitCode> {
    let mut interrupts = Interrupts::new()?;
    let server = Server::start(&arguments.server, log).await?;
    println!("torqued {} at {}", env!("CARGO_PKG_VERSION"), server.url);
    server.run_until_interrupted(&mut interrupts).await?;
    Ok(ExitCode::SUCCESS)
}

/// Does `work` with a server. Then serves until Ctrl-C, unless `exit` is set or the work failed.
pub async fn work_and_serve(
    options: &Options,
    log: &Logging,
    exit: bool,
    work: impl AsyncFnOnce(&Server) -> anyhow::Result<()>,
) -> anyhow::Result<ExitCode> {
    let mut interrupts = Interrupts::new()?;
    let server = Server::start(options, log).await?;
    let result = tokio::select! {
        result = work(&server) => result,
        () = interrupts.next() => {
            eprintln!("stopping; run the command again to continue");
            server.stop(&mut interrupts).await;
            return Ok(ExitCode::from(INTERRUPTED));
        }
    };
    if result.is_err() || exit {
        server.stop(&mut interrupts).await;
        return result.map(|()| ExitCode::SUCCESS);
    }
    eprintln!("serving until Ctrl-C");
    server.run_until_interrupted(&mut interrupts).await?;
    Ok(ExitCode::SUCCESS)
}

#[derive(Debug, Args)]
pub struct QuickstartArguments {
    /// Compute everything again, even what was done before
    #[arg(long)]
    force: bool,

    /// Exit after printing the result, instead of serving until Ctrl-C
    #[arg(long)]
    exit: bool,

    #[command(flatten)]
    server: Options,
}

const SPEC: &str = r#"{"preset": "quickstart"}"#;

pub async fn quickstart(arguments: QuickstartArguments, log: &Logging) -> anyhow::Result<ExitCode> {
    let work = async |server: &Server| compute_and_show(&arguments, server).await;
    work_and_serve(&arguments.server, log, arguments.exit, work).await
}

async fn compute_and_show(arguments: &QuickstartArguments, server: &Server) -> anyhow::Result<()> {
    let client = Client::new(&server.url, Some(server.own_token.clone()))?;
    let reuse = if arguments.force { Reuse::ComputeAnew } else { Reuse::ByDigest };
    let Submitted { job, existed } = client.submit(SPEC.into(), reuse).await?;
    let page = client.url(&format!("/jobs/{}", job.id));
    match (existed, job.state) {
        (true, JobState::Succeeded) => {
            eprintln!("job {} did all this before: nothing to compute, --force does", job.id);
        }
        (true, _) => eprintln!("continuing with job {}: {page}", job.id),
        (false, _) => eprintln!("job {}: {page}", job.id),
    }
    let job = progress::follow(&client, job.id).await?;
    if job.state != JobState::Succeeded {
        return Err(JobEnded::new(&job).into());
    }
    let evaluation = member(&job, "evaluate")?;
    let report = client
        .evaluation(evaluation)
        .await?
        .report
        .with_context(|| format!("evaluation {evaluation} has no report"))?;
    print!("{}", reports::text(&report));
    print_places(&client, server, &job, &page).await
}

fn member(job: &Job, name: &str) -> anyhow::Result<i64> {
    let member = job.members.iter().find(|member| member.name == name);
    member.map(|member| member.job).with_context(|| format!("job {} has no {name:?}", job.id))
}

async fn print_places(
    client: &Client,
    server: &Server,
    job: &Job,
    page: &str,
) -> anyhow::Result<()> {
    let mut table = Table::new([("result", Align::Left), ("where", Align::Left)]);
    for name in ["train-set", "test-grid"] {
        let simulation = client.job(member(job, name)?).await?;
        let id = simulation.dataset.with_context(|| format!("{name} has no dataset"))?;
        let dataset = client.dataset(id).await?;
        let megabytes = dataset.bytes as f64 / 1e6;
        let what = format!("{name}, {} trajectories, {megabytes:.1} MB", dataset.trajectories);
        table.push(vec![what, server.dataset_folder(id).await?.display().to_string()]);
    }
    for name in ["train-lagrangian", "train"] {
        let training = client.job(member(job, name)?).await?;
        let last = *training.checkpoints.iter().max().context("the training left no checkpoint")?;
        let checkpoint = client.checkpoint(last).await?;
        let what = format!(
            "checkpoint {last}, {} after {} steps",
            checkpoint.architecture, checkpoint.step
        );
        table.push(vec![what, server.checkpoint_folder(last).await?.display().to_string()]);
    }
    let report = server.artifact_file(member(job, "evaluate")?, "report.json").await?;
    table.push(vec!["report".to_owned(), report.display().to_string()]);
    table.push(vec!["page".to_owned(), page.to_owned()]);
    print!("{}", table.render());
    Ok(())
}
