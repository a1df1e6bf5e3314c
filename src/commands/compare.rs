//! Runs beside each other.

use std::process::ExitCode;

use clap::Args;
use reports::comparison;
use wire::Run;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Two runs or more; `torqued runs` lists them
    #[arg(value_name = "RUN", required = true, num_args = 2..=api::limits::COMPARED_RUNS)]
    runs: Vec<i64>,

    /// Show parameters that all runs share, too
    #[arg(long)]
    all: bool,

    /// Print CSV
    #[arg(long, conflicts_with = "json")]
    csv: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let mut runs: Vec<Run> = Vec::new();
    for id in arguments.runs {
        runs.push(client.get(&format!("/v1/runs/{id}")).await?);
    }
    if arguments.output.json {
        write_json(&runs)?;
        return Ok(ExitCode::SUCCESS);
    }
    let tables = [comparison::metrics(&runs), comparison::parameters(&runs, arguments.all)];
    for table in tables.iter().filter(|table| !table.rows.is_empty()) {
        if arguments.csv {
            print!("{}", table.to_csv()?);
        } else {
            print!("{}", table.with_title());
        }
    }
    Ok(ExitCode::SUCCESS)
}
