use std::process::ExitCode;

use clap::Args;

use crate::arguments::ServerArguments;
use crate::client::Submitted;
use crate::commands::watch;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The id of a job that failed or was cancelled
    id: i64,

    /// Follow the new job until it ends
    #[arg(long)]
    watch: bool,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let Submitted { job, existed } = client.retry(arguments.id).await?;
    let note = if existed { ", tried again before" } else { "" };
    println!("job {} {}{note}: {}", job.id, job.state, client.url(&format!("/jobs/{}", job.id)));
    if arguments.watch { watch::to_the_end(&client, job.id).await } else { Ok(ExitCode::SUCCESS) }
}
