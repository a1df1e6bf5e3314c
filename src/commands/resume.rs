use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let queue = arguments.server.client()?.resume_queue().await?;
    if arguments.output.json {
        write_json(&queue)?;
    } else {
        println!("resumed; {} tasks wait, {} run", queue.queued, queue.running);
    }
    Ok(ExitCode::SUCCESS)
}
