use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::client::Submitted;
use crate::commands::watch;
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The id of a job that failed or was cancelled
    id: i64,

    /// Follow the new job until it ends
    #[arg(long)]
    watch: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let Submitted { job, existed } = client.retry(arguments.id).await?;
    let output = arguments.output;
    let note = if existed { ", retried before" } else { "" };
    match (output.json, arguments.watch) {
        (false, _) => {
            let page = client.url(&format!("/jobs/{}", job.id));
            println!("job {} {}{note}: {page}", job.id, job.state);
        }
        (true, false) => write_json(&job)?,
        (true, true) => {}
    }
    if !arguments.watch {
        return Ok(ExitCode::SUCCESS);
    }
    watch::follow_to_end(&client, job.id, output).await
}
