use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments, worker_name};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The worker's name; `torqued workers` lists them
    #[arg(value_name = "WORKER", value_parser = worker_name)]
    worker: String,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let worker = arguments.server.client()?.undrain_worker(&arguments.worker).await?;
    if arguments.output.json {
        write_json(&worker)?;
    } else {
        println!("{} begins tasks again", worker.name);
    }
    Ok(ExitCode::SUCCESS)
}
