use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::lists;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job
    #[arg(value_name = "JOB")]
    job: i64,

    /// Largest number of attempts to list
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=500))]
    limit: u32,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let path = format!("/v1/jobs/{}/attempts?limit={}", arguments.job, arguments.limit);
    let client = arguments.server.client()?;
    if arguments.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    print!("{}", lists::table(&client.attempts(&path).await?.attempts));
    Ok(ExitCode::SUCCESS)
}
