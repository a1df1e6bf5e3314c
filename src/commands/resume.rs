use std::process::ExitCode;

use clap::Args;

use crate::arguments::ServerArguments;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let queue = arguments.server.client()?.resume_queue().await?;
    println!("goes on; {} tasks wait, {} run", queue.queued, queue.running);
    Ok(ExitCode::SUCCESS)
}
