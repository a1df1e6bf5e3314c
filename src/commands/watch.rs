use std::process::ExitCode;

use clap::Args;

use crate::cli::ServerArguments;
use crate::client::{Client, JobState};
use crate::progress;

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

/// Follows a job; only success is a success.
pub async fn to_the_end(client: &Client, id: i64) -> anyhow::Result<ExitCode> {
    let job = progress::follow(client, id).await?;
    let reason = job.error.map(|error| format!(": {error}")).unwrap_or_default();
    println!("job {id} {}{reason}", job.state);
    match job.state {
        JobState::Succeeded => Ok(ExitCode::SUCCESS),
        _ => Ok(ExitCode::FAILURE),
    }
}
