use std::process::ExitCode;

use clap::Args;
use spec::JobKind;
use wire::{Job, JobState};

use crate::arguments::ServerArguments;
use crate::client::Client;
use crate::progress;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job's id
    id: i64,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    to_the_end(&client, arguments.id).await
}

/// Follows a job; only success is a success. Prints what its jobs found, except for those whose
/// datasets and checkpoints speak for them.
pub async fn to_the_end(client: &Client, id: i64) -> anyhow::Result<ExitCode> {
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
                let report = client.control_report(run).await?;
                print!("{}", reports::closed_loop_text(&job.name, &report));
            }
            _ if job.dataset.is_none() && job.checkpoints.is_empty() => {
                if let Some(findings) = wire::findings(&client.tasks(job.id).await?) {
                    println!("{}: {findings}", job.name);
                }
            }
            _ => {}
        }
    }
    match job.state {
        JobState::Succeeded => Ok(ExitCode::SUCCESS),
        _ => Ok(ExitCode::FAILURE),
    }
}

/// The jobs that succeeded: the job itself, or members of a pipeline.
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
