use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let queue = arguments.server.client()?.queue().await?;
    if arguments.output.json {
        write_json(&queue)?;
        return Ok(ExitCode::SUCCESS);
    }
    let state = match (queue.paused, &queue.paused_at) {
        (false, _) => "running".to_owned(),
        (true, None) => "paused".to_owned(),
        (true, Some(since)) => format!("paused {}", measure::ago(since)),
    };
    println!("{state}; {} tasks wait, {} run", queue.queued, queue.running);
    Ok(ExitCode::SUCCESS)
}
