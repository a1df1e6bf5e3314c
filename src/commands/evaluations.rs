use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Evaluation, Evaluations, TaskState};

use crate::lists::{ListArguments, both};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Only evaluations in this state
    #[arg(long, value_name = "STATE", value_parser = crate::commands::jobs::states())]
    state: Option<String>,

    #[command(flatten)]
    list: ListArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { state, list } = arguments;
    let client = list.server.client()?;
    let filters = [("state", &state)];
    let mut last = None;
    let mut table = Table::new([
        ("id", Align::Right),
        ("name", Align::Left),
        ("state", Align::Left),
        ("cells", Align::Right),
        ("run", Align::Right),
        ("created", Align::Right),
        ("tags", Align::Left),
    ]);
    let rest = list.each_page(&client, "/v1/evaluations", &filters, |page| {
        if list.output.json {
            println!("{page}");
            return Ok(());
        }
        let page: Evaluations = serde_json::from_str(page)?;
        for item in page.evaluations {
            last = Some(item.id);
            table.push(row(item));
        }
        Ok(())
    });
    let rest = rest.await?;
    if !list.output.json {
        print!("{}", table.render());
        list.print_rest("evaluations", &rest, last);
    }
    Ok(ExitCode::SUCCESS)
}

fn row(evaluation: Evaluation) -> Vec<String> {
    let done = evaluation.cells.iter().filter(|cell| cell.state == TaskState::Succeeded).count();
    let cells = match evaluation.cells.len() {
        0 => String::new(),
        all => format!("{done} of {all}"),
    };
    vec![
        evaluation.id.to_string(),
        evaluation.name,
        evaluation.state.to_string(),
        cells,
        evaluation.run.to_string(),
        measure::ago(&evaluation.created_at),
        both(&evaluation.tags, &[]),
    ]
}
