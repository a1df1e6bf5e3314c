use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Run, Runs};

use crate::lists::{ListArguments, both};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Only runs of jobs of this kind
    #[arg(long, value_name = "KIND", value_parser = crate::commands::jobs::kinds())]
    kind: Option<String>,

    /// Only runs of jobs in this state
    #[arg(long, value_name = "STATE", value_parser = crate::commands::jobs::states())]
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
        ("kind", Align::Left),
        ("name", Align::Left),
        ("state", Align::Left),
        ("step", Align::Right),
        ("job", Align::Right),
        ("created", Align::Right),
        ("tags", Align::Left),
    ]);
    let rest = list.each_page(&client, "/v1/runs", &filters, |page| {
        if list.output.json {
            println!("{page}");
            return Ok(());
        }
        let page: Runs = serde_json::from_str(page)?;
        for item in page.runs {
            last = Some(item.id);
            table.push(row(item));
        }
        Ok(())
    });
    let rest = rest.await?;
    if !list.output.json {
        print!("{}", table.render());
        list.print_rest("runs", &rest, last);
    }
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
        both(&run.tags, &run.job_tags),
    ]
}
