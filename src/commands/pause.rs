use std::process::ExitCode;
use std::time::Duration;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Wait until no worker has a task
    #[arg(long)]
    wait: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// Pause between two looks at the remaining tasks.
const LOOK_EVERY: Duration = Duration::from_secs(1);

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let mut queue = client.pause_queue().await?;
    if !arguments.output.json {
        println!("paused; {} tasks wait, {} still run", queue.queued, queue.running);
    }
    while arguments.wait && queue.running > 0 {
        tokio::time::sleep(LOOK_EVERY).await;
        queue = client.queue().await?;
    }
    if arguments.output.json {
        write_json(&queue)?;
    } else if arguments.wait {
        println!("no task is running; `torqued resume` resumes the queue");
    }
    Ok(ExitCode::SUCCESS)
}
