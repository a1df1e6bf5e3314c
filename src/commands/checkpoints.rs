use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Checkpoint, Checkpoints};

use crate::lists::{ListArguments, print_next};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    list: ListArguments,
}

/// The metric that tells checkpoints apart.
const ERROR: &str = "validation/rmse_deg";

pub async fn run(Arguments { list }: Arguments) -> anyhow::Result<ExitCode> {
    let client = list.server.client()?;
    let path = list.path("/v1/checkpoints");
    if list.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let Checkpoints { checkpoints, next } = client.get(&path).await?;
    let mut table = Table::new([
        ("id", Align::Right),
        ("model", Align::Left),
        ("step", Align::Right),
        ("error", Align::Right),
        ("is", Align::Left),
        ("size", Align::Right),
        ("job", Align::Right),
        ("created", Align::Right),
    ]);
    for checkpoint in &checkpoints {
        table.push(row(checkpoint));
    }
    print!("{}", table.render());
    print_next("checkpoints", next);
    Ok(ExitCode::SUCCESS)
}

fn row(checkpoint: &Checkpoint) -> Vec<String> {
    let error = checkpoint.metrics.get(ERROR).map(|error| format!("{error:.3}°"));
    let size = checkpoint.files.iter().map(|file| file.size).sum();
    vec![
        checkpoint.id.to_string(),
        checkpoint.architecture.clone(),
        measure::count(checkpoint.step),
        error.unwrap_or_default(),
        marks(checkpoint),
        measure::size(size),
        checkpoint.job.to_string(),
        measure::ago(&checkpoint.created_at),
    ]
}

/// Which of its training's checkpoints it is: `best, final`.
pub fn marks(checkpoint: &Checkpoint) -> String {
    let marks = [
        (checkpoint.is_best, "best"),
        (checkpoint.is_final, "final"),
        (checkpoint.is_last && !checkpoint.is_final, "last"),
    ];
    let marks: Vec<&str> = marks.into_iter().filter_map(|(is, mark)| is.then_some(mark)).collect();
    marks.join(", ")
}
