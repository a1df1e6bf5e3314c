use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Evaluation, Evaluations, TaskState};

use crate::lists::{ListArguments, print_next};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    list: ListArguments,
}

pub async fn run(Arguments { list }: Arguments) -> anyhow::Result<ExitCode> {
    let client = list.server.client()?;
    let path = list.path("/v1/evaluations");
    if list.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let Evaluations { evaluations, next } = client.get(&path).await?;
    let mut table = Table::new([
        ("id", Align::Right),
        ("name", Align::Left),
        ("state", Align::Left),
        ("cells", Align::Right),
        ("run", Align::Right),
        ("created", Align::Right),
    ]);
    for evaluation in evaluations {
        table.push(row(evaluation));
    }
    print!("{}", table.render());
    print_next("evaluations", next);
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
    ]
}
