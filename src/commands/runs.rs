use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Run, Runs};

use crate::lists::{ListArguments, print_next};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    list: ListArguments,
}

pub async fn run(Arguments { list }: Arguments) -> anyhow::Result<ExitCode> {
    let client = list.server.client()?;
    let path = list.path("/v1/runs");
    if list.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let Runs { runs, next } = client.get(&path).await?;
    let mut table = Table::new([
        ("id", Align::Right),
        ("kind", Align::Left),
        ("name", Align::Left),
        ("state", Align::Left),
        ("step", Align::Right),
        ("job", Align::Right),
        ("created", Align::Right),
    ]);
    for run in runs {
        table.push(row(run));
    }
    print!("{}", table.render());
    print_next("runs", next);
    Ok(ExitCode::SUCCESS)
}

fn row(run: Run) -> Vec<String> {
    let step = run.metrics.values().map(|metric| metric.step).max();
    vec![
        run.id.to_string(),
        run.kind.to_string(),
        run.name,
        run.state.to_string(),
        step.map(measure::count).unwrap_or_default(),
        run.job.to_string(),
        measure::ago(&run.created_at),
    ]
}
