use std::process::ExitCode;

use clap::Args;

use crate::arguments::ServerArguments;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job's id
    id: i64,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let job = client.cancel(arguments.id).await?;
    if job.state.is_final() {
        println!("job {} {}", job.id, job.state);
    } else {
        println!("job {} {}, its worker was told to stop", job.id, job.state);
    }
    Ok(ExitCode::SUCCESS)
}
