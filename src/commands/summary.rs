use std::process::ExitCode;

use clap::{Args, ValueEnum};
use reports::{Align, Table};
use spec::JobKind;
use wire::{ChannelSummary, Summary};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::progress::measure;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The dataset
    #[arg(value_name = "DATASET")]
    dataset: i64,

    /// Print the mean spectra of torques and positions in this format, instead of the ranges of the
    /// channels
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
    let mut table = Table::new([
        ("channel", Align::Left),
        ("unit", Align::Left),
        ("lowest", Align::Right),
        ("highest", Align::Right),
        ("mean", Align::Right),
        ("std", Align::Right),
    ]);
    for channel in summary.channels {
        table.push(row(channel));
    }
    print!("{}", table.render());
    Ok(ExitCode::SUCCESS)
}

fn row(channel: ChannelSummary) -> Vec<String> {
    let ChannelSummary { name, unit, min, max, mean, std, .. } = channel;
    let numbers = [min, max, mean, std].map(|number| format!("{number:.4}"));
    [name, unit.unwrap_or_default()].into_iter().chain(numbers).collect()
}
