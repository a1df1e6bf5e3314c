use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::lists;
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job
    #[arg(value_name = "JOB")]
    job: i64,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let tasks = arguments.server.client()?.tasks(arguments.job).await?;
    if arguments.output.json {
        for task in &tasks {
            write_json(task)?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    print!("{}", lists::table(&tasks));
    Ok(ExitCode::SUCCESS)
}
