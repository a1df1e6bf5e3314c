use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Dataset, Datasets};

use crate::lists::{ListArguments, print_next};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    list: ListArguments,
}

pub async fn run(Arguments { list }: Arguments) -> anyhow::Result<ExitCode> {
    let client = list.server.client()?;
    let path = list.path("/v1/datasets");
    if list.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let Datasets { datasets, next } = client.get(&path).await?;
    let mut table = Table::new([
        ("id", Align::Right),
        ("name", Align::Left),
        ("state", Align::Left),
        ("trajectories", Align::Right),
        ("samples", Align::Right),
        ("size", Align::Right),
        ("job", Align::Right),
        ("created", Align::Right),
    ]);
    for dataset in datasets {
        table.push(row(dataset));
    }
    print!("{}", table.render());
    print_next("datasets", next);
    Ok(ExitCode::SUCCESS)
}

fn row(dataset: Dataset) -> Vec<String> {
    vec![
        dataset.id.to_string(),
        dataset.name,
        dataset.state.to_string(),
        measure::count(dataset.trajectories),
        dataset.samples.to_string(),
        measure::size(dataset.bytes),
        dataset.job.to_string(),
        measure::ago(&dataset.created_at),
    ]
}
