use std::process::ExitCode;

use clap::Args;
use reports::{Align, Table};
use wire::{Checkpoint, Checkpoints};

use crate::lists::{ListArguments, both};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    list: ListArguments,
}

/// The metric that is shown for checkpoints.
const ERROR: &str = "validation/rmse_deg";

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Arguments { list } = arguments;
    let client = list.server.client()?;
    let mut last = None;
    let mut table = Table::new([
        ("id", Align::Right),
        ("name", Align::Left),
        ("model", Align::Left),
        ("step", Align::Right),
        ("error", Align::Right),
        ("is", Align::Left),
        ("size", Align::Right),
        ("job", Align::Right),
        ("created", Align::Right),
        ("tags", Align::Left),
    ]);
    let rest = list.each_page(&client, "/v1/checkpoints", &[], |page| {
        if list.output.json {
            println!("{page}");
            return Ok(());
        }
        let page: Checkpoints = serde_json::from_str(page)?;
        for item in page.checkpoints {
            last = Some(item.id);
            table.push(row(&item));
        }
        Ok(())
    });
    let rest = rest.await?;
    if !list.output.json {
        print!("{}", table.render());
        list.print_rest("checkpoints", &rest, last);
    }
    Ok(ExitCode::SUCCESS)
}

fn row(checkpoint: &Checkpoint) -> Vec<String> {
    let error = checkpoint.metrics.get(ERROR).map(|error| format!("{error:.3}°"));
    let size = checkpoint.files.iter().map(|file| file.size).sum();
    vec![
        checkpoint.id.to_string(),
        checkpoint.name.clone().unwrap_or_default(),
        checkpoint.architecture.clone(),
        measure::count(checkpoint.step),
        error.unwrap_or_default(),
        marks(checkpoint),
        measure::size(size),
        checkpoint.job.to_string(),
        measure::ago(&checkpoint.created_at),
        both(&checkpoint.tags, &checkpoint.job_tags),
    ]
}

/// Marks among the checkpoints of its training, e.g. `best, final`.
pub fn marks(checkpoint: &Checkpoint) -> String {
    let marks = [
        (checkpoint.is_best, "best"),
        (checkpoint.is_final, "final"),
        (checkpoint.is_last && !checkpoint.is_final, "last"),
    ];
    let marks: Vec<&str> = marks.into_iter().filter_map(|(is, mark)| is.then_some(mark)).collect();
    marks.join(", ")
}
