use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;

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
    let job = client.cancel(arguments.id).await?;
    if arguments.output.json {
        write_json(&job)?;
    } else if job.state.is_final() {
        println!("job {} {}", job.id, job.state);
    } else {
        println!("job {} {}, its worker was told to stop", job.id, job.state);
    }
    Ok(ExitCode::SUCCESS)
}
