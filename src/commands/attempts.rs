use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Attempt, AttemptOutcome};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;

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
    let mut table = Table::new([
        ("id", Align::Right),
        ("task", Align::Left),
        ("worker", Align::Left),
        ("started", Align::Right),
        ("took", Align::Right),
        ("ended", Align::Left),
        ("because", Align::Left),
    ]);
    for attempt in client.attempts(&path).await?.attempts {
        table.push(row(attempt));
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}

fn row(attempt: Attempt) -> Vec<String> {
    let started = measure::since(&attempt.started_at, None);
    let took = measure::since(&attempt.started_at, attempt.ended_at.as_deref());
    vec![
        attempt.id.to_string(),
        attempt.label,
        attempt.worker,
        started.map(|age| format!("{} ago", measure::duration(age))).unwrap_or_default(),
        took.map(measure::duration).unwrap_or_default(),
        attempt.outcome.map_or("still running", AttemptOutcome::as_str).to_owned(),
        attempt.reason.unwrap_or_default(),
    ]
}
