use std::process::ExitCode;

use clap::Args;
use clap::builder::PossibleValuesParser;
use reports::{Align, Table};
use wire::{Dataset, DatasetState, Datasets};

use crate::lists::{ListArguments, both};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Only datasets from jobs of this kind
    #[arg(long, value_name = "KIND", value_parser = crate::commands::jobs::kinds())]
    kind: Option<String>,

    /// Only datasets in this state
    #[arg(long, value_name = "STATE", value_parser = states())]
    state: Option<String>,

    #[command(flatten)]
    list: ListArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { kind, state, list } = arguments;
    let client = list.server.client()?;
    let filters = [("kind", &kind), ("state", &state)];
    let mut last = None;
    let mut table = Table::new([
        ("id", Align::Right),
        ("name", Align::Left),
        ("state", Align::Left),
        ("trajectories", Align::Right),
        ("samples", Align::Right),
        ("size", Align::Right),
        ("job", Align::Right),
        ("created", Align::Right),
        ("tags", Align::Left),
    ]);
    let rest = list.each_page(&client, "/v1/datasets", &filters, |page| {
        if list.output.json {
            println!("{page}");
            return Ok(());
        }
        let page: Datasets = serde_json::from_str(page)?;
        for item in page.datasets {
            last = Some(item.id);
            table.push(row(item));
        }
        Ok(())
    });
    let rest = rest.await?;
    if !list.output.json {
        print!("{}", table.render());
        list.print_rest("datasets", &rest, last);
    }
    Ok(ExitCode::SUCCESS)
}

fn states() -> PossibleValuesParser {
    PossibleValuesParser::new(DatasetState::ALL.map(DatasetState::as_str))
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
        both(&dataset.tags, &dataset.job_tags),
    ]
}
