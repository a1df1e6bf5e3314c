use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::arguments::{OutputArguments, ServerArguments};
use crate::commands::submit::read_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The checkpoint; `torqued checkpoints` lists them
    #[arg(value_name = "CHECKPOINT")]
    checkpoint: i64,

    /// The request as JSON, see docs/prediction.md; `-` reads standard input
    #[arg(value_name = "FILE")]
    question: PathBuf,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let question = read_json(&arguments.question, api::limits::QUESTION_BYTES as u64)?;
    let client = arguments.server.client()?;
    let answer = client.predict(arguments.checkpoint, question).await?;
    if arguments.output.json {
        println!("{answer}");
    } else {
        let answer: serde_json::Value = serde_json::from_str(&answer)?;
        println!("{}", serde_json::to_string_pretty(&answer)?);
    }
    Ok(ExitCode::SUCCESS)
}
