use std::process::ExitCode;

use clap::{Args, ValueEnum};
use spec::JobKind;
use wire::Summary;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The dataset
    #[arg(value_name = "DATASET")]
    dataset: i64,

    /// Print the mean spectra of torques and positions in this format, instead of the ranges of
    /// channels and arms
    #[arg(long, value_name = "FORMAT", value_enum, conflicts_with = "json")]
    spectrum: Option<Drawing>,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// The format of a drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Drawing {
    Csv,
    Svg,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let id = arguments.dataset;
    if let Some(drawing) = arguments.spectrum {
        let name = if drawing == Drawing::Csv { "csv" } else { "svg" };
        print!("{}", client.raw(&format!("/v1/datasets/{id}/spectrum.{name}")).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let path = format!("/v1/datasets/{id}/summary");
    if arguments.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let summary: Summary = client.get(&path).await?;
    let [trajectories, samples, rejected] =
        [summary.trajectories, summary.samples, summary.rejected].map(measure::count);
    // Only a simulation draws robots.
    let dataset = client.dataset(id).await?;
    let is_simulated = dataset.spec["kind"] == JobKind::Simulate.as_str();
    let rejected = if is_simulated { format!(", {rejected} draws refused") } else { String::new() };
    println!("{trajectories} trajectories, {samples} samples{rejected}");
    print!("{}", reports::channels::table(&summary).render());
    for table in reports::channels::arms(&summary) {
        print!("\n{}. {}\n{}", table.title, table.note, table.render());
    }
    Ok(ExitCode::SUCCESS)
}
