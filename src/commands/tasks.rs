use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::Task;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;
use crate::progress::measure;

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
    let mut table = Table::new([
        ("id", Align::Right),
        ("stage", Align::Right),
        ("task", Align::Left),
        ("state", Align::Left),
        ("done", Align::Right),
        ("attempt", Align::Right),
        ("worker", Align::Left),
        ("took", Align::Right),
        ("error", Align::Left),
    ]);
    for task in tasks {
        table.push(row(task));
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}

fn row(task: Task) -> Vec<String> {
    let took = task
        .started_at
        .as_deref()
        .and_then(|from| measure::since(from, task.finished_at.as_deref()));
    let done = match task.progress.total {
        0 => String::new(),
        total => format!("{} of {}", measure::count(task.progress.done), measure::count(total)),
    };
    vec![
        task.id.to_string(),
        task.stage.to_string(),
        task.label,
        task.state.to_string(),
        done,
        format!("{} of {}", task.attempt, task.max_attempts),
        task.worker.unwrap_or_default(),
        took.map(measure::duration).unwrap_or_default(),
        task.error.unwrap_or_default(),
    ]
}
