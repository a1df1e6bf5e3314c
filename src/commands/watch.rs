use std::process::ExitCode;

use clap::Args;
use spec::JobKind;
use wire::{Job, JobState};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::client::Client;
use crate::exit::JOB_FAILED;
use crate::output::write_json;
use crate::progress;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job's id
    id: i64,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    follow_to_end(&client, arguments.id, arguments.output).await
}

/// Follows a job to its end. Only a job that succeeds gives exit code 0. Prints the findings of its
/// jobs, except for jobs that leave datasets or checkpoints. With JSON, prints only the job, each
/// time it changes.
pub async fn follow_to_end(
    client: &Client,
    id: i64,
    output: OutputArguments,
) -> anyhow::Result<ExitCode> {
    if output.json {
        return print_changes(client, id).await;
    }
    let job = progress::follow(client, id).await?;
    let reason = job.error.as_ref().map(|error| format!(": {error}")).unwrap_or_default();
    println!("job {id} {}{reason}", job.state);
    for job in succeeded(client, &job).await? {
        match (job.kind, job.run) {
            (JobKind::Evaluate, _) => {
                if let Some(report) = client.evaluation(job.id).await?.report {
                    print!("{}", reports::text(&report));
                }
            }
            (JobKind::Control, Some(run)) => {
                let report = client.report(run).await?;
                print!("{}", reports::closed_loop::text(&job.name, &report));
            }
            (JobKind::Identify, Some(run)) => {
                let report = client.report(run).await?;
                print!("\n{}\n\n{}", job.name, reports::identification::text(&report));
            }
            _ if job.dataset.is_none() && job.checkpoints.is_empty() => {
                if let Some(findings) = wire::findings(&client.tasks(job.id).await?) {
                    println!("{}: {findings}", job.name);
                }
            }
            _ => {}
        }
    }
    Ok(code(&job))
}

async fn print_changes(client: &Client, id: i64) -> anyhow::Result<ExitCode> {
    let mut last: Option<Job> = None;
    let mut written = Ok(());
    let job = progress::follow_quietly(client, id, |job| {
        if last.as_ref() != Some(job) && written.is_ok() {
            written = write_json(job);
            last = Some(job.clone());
        }
    });
    let job = job.await?;
    written?;
    Ok(code(&job))
}

fn code(job: &Job) -> ExitCode {
    match job.state {
        JobState::Succeeded => ExitCode::SUCCESS,
        _ => ExitCode::from(JOB_FAILED),
    }
}

/// The jobs that succeeded: the job itself, or the members of a pipeline.
async fn succeeded(client: &Client, job: &Job) -> anyhow::Result<Vec<Job>> {
    if job.members.is_empty() {
        return Ok(if job.state == JobState::Succeeded { vec![job.clone()] } else { Vec::new() });
    }
    let mut jobs = Vec::new();
    for member in job.members.iter().filter(|member| member.state == JobState::Succeeded) {
        jobs.push(client.job(member.job).await?);
    }
    Ok(jobs)
}
