use std::process::ExitCode;

use clap::Args;

use crate::cli::ServerArguments;
use crate::client::{Client, Job, JobState};
use crate::progress;
use crate::report;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job's id
    id: i64,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = Client::new(&arguments.server.server, arguments.server.token)?;
    to_the_end(&client, arguments.id).await
}

/// Follows a job; only success is a success. Prints what its evaluations found.
pub async fn to_the_end(client: &Client, id: i64) -> anyhow::Result<ExitCode> {
    let job = progress::follow(client, id).await?;
    let reason = job.error.as_ref().map(|error| format!(": {error}")).unwrap_or_default();
    println!("job {id} {}{reason}", job.state);
    for evaluation in evaluations(client, &job).await? {
        if let Some(report) = client.evaluation(evaluation).await?.report {
            report::print(&report);
        }
    }
    match job.state {
        JobState::Succeeded => Ok(ExitCode::SUCCESS),
        _ => Ok(ExitCode::FAILURE),
    }
}

/// Evaluations that succeeded: the job itself, or members of a pipeline.
async fn evaluations(client: &Client, job: &Job) -> anyhow::Result<Vec<i64>> {
    const KIND: &str = "evaluate";
    if job.kind == KIND {
        return Ok(if job.state == JobState::Succeeded { vec![job.id] } else { Vec::new() });
    }
    let mut evaluations = Vec::new();
    for member in job.members.iter().filter(|member| member.state == JobState::Succeeded) {
        if client.job(member.job).await?.kind == KIND {
            evaluations.push(member.job);
        }
    }
    Ok(evaluations)
}
