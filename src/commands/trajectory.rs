use std::io::IsTerminal;
use std::process::ExitCode;

use anyhow::bail;
use clap::{Args, ValueEnum};

use crate::arguments::AskArguments;
use crate::output::write_bytes;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The dataset
    #[arg(value_name = "DATASET")]
    dataset: i64,

    /// Index in the dataset, from 0
    #[arg(value_name = "INDEX")]
    index: u64,

    /// Output format
    #[arg(long, value_name = "FORMAT", value_enum, default_value_t = Format::Csv, conflicts_with = "json")]
    format: Format,

    #[command(flatten)]
    ask: AskArguments,
}

/// The output format of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// One line per sample
    Csv,
    /// A figure
    Svg,
    /// An Arrow IPC stream
    Arrow,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let base = format!("/v1/datasets/{}/trajectories/{}", arguments.dataset, arguments.index);
    let client = arguments.ask.client()?;
    if arguments.ask.output.json {
        println!("{}", client.raw(&format!("{base}?format=json")).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let path = match arguments.format {
        Format::Csv => format!("{base}/figure.csv"),
        Format::Svg => format!("{base}/figure.svg"),
        Format::Arrow if std::io::stdout().is_terminal() => {
            bail!("an Arrow stream is binary; redirect it to a file instead of the terminal");
        }
        Format::Arrow => format!("{base}?format=arrow"),
    };
    write_bytes(&client.download(&path).await?)?;
    Ok(ExitCode::SUCCESS)
}
