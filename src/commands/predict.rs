//! Predictions with a checkpoint: single ones, or a stream.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use futures::StreamExt as _;
use reports::json::readable;
use tokio_util::codec::{FramedRead, LinesCodec};
use wire::{StreamReply, TrajectoryPrediction, TrajectoryPredictions, Warning};

use crate::arguments::{AskArguments, ServerArguments};
use crate::client::ClientError;
use crate::commands::submit::read_json;
use crate::resource::Reference;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The checkpoint, by its id or an alias; `torqued checkpoints` lists them
    #[arg(value_name = "CHECKPOINT")]
    checkpoint: Reference,

    /// The request as JSON, see docs/prediction.md; `-` reads standard input
    #[arg(value_name = "FILE", required_unless_present = "dataset")]
    question: Option<PathBuf>,

    /// The request asks for the torques that a motion takes
    #[arg(long, conflicts_with = "dataset")]
    torque: bool,

    /// Predict a trajectory of this dataset, and print the errors
    #[arg(long, value_name = "DATASET", requires = "trajectory", conflicts_with = "question")]
    dataset: Option<i64>,

    /// Index of that trajectory, from 0
    #[arg(long, value_name = "INDEX", requires = "dataset")]
    trajectory: Option<u64>,

    /// Further checkpoints beside the first
    #[arg(long, value_name = "CHECKPOINT", value_delimiter = ',', requires = "dataset")]
    beside: Vec<Reference>,

    /// Samples of each checkpoint that gives several answers; 16 by default
    #[arg(long, value_name = "N", requires = "dataset")]
    samples: Option<u32>,

    /// Steps of the samplers of models that remove noise; those of the training by default
    #[arg(long, value_name = "N", requires = "dataset")]
    steps: Option<u32>,

    /// The sample at which the horizon begins; the end of the longest context by default
    #[arg(long, value_name = "SAMPLE", requires = "dataset")]
    begin: Option<u64>,

    /// The seed of all samples
    #[arg(long, value_name = "SEED", requires = "dataset")]
    seed: Option<u64>,

    #[command(flatten)]
    ask: AskArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let Some(question) = &arguments.question else { return stored(&arguments).await };
    let question = read_json(question, api::limits::QUESTION_BYTES as u64)?;
    let client = arguments.ask.client()?;
    let what = if arguments.torque { "torque" } else { "predict" };
    let answer = client.question(&arguments.checkpoint, what, question).await;
    let answer = answer.map_err(|error| with_flag(error, arguments.torque))?;
    if arguments.ask.output.json {
        println!("{answer}");
    } else {
        let answer: serde_json::Value = serde_json::from_str(&answer)?;
        println!("{}", readable(&answer));
    }
    Ok(ExitCode::SUCCESS)
}

/// A refusal, and whether `--torque` is for this request.
fn with_flag(error: ClientError, asks_for_torques: bool) -> ClientError {
    let ClientError::Refused { fields, .. } = &error else { return error };
    let has = |name: &str| fields.iter().any(|field| field.ends_with(&format!("].{name}")));
    match asks_for_torques {
        false if has("motion") => error.with_advice("--torque asks for the torques of a motion"),
        true if has("future_u") || has("futures") => {
            error.with_advice("without --torque, the positions under future torques are predicted")
        }
        _ => error,
    }
}

/// Predicts a stored trajectory, and prints the errors.
async fn stored(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let (Some(dataset), Some(trajectory)) = (arguments.dataset, arguments.trajectory) else {
        anyhow::bail!("neither a request nor a dataset and a trajectory is given");
    };
    let ids = std::iter::once(&arguments.checkpoint).chain(&arguments.beside);
    let ids: Vec<String> = ids.map(Reference::to_string).collect();
    let mut query = format!("checkpoint={}", ids.join(","));
    let given = [
        ("samples", arguments.samples.map(u64::from)),
        ("steps", arguments.steps.map(u64::from)),
        ("begin", arguments.begin),
        ("seed", arguments.seed),
    ];
    for (name, value) in given {
        query.extend(value.map(|value| format!("&{name}={value}")));
    }
    let path = format!("/v1/datasets/{dataset}/trajectories/{trajectory}/predictions?{query}");
    let client = arguments.ask.client()?;
    if arguments.ask.output.json {
        println!("{}", client.raw(&path).await?);
        return Ok(ExitCode::SUCCESS);
    }
    let predictions: TrajectoryPredictions = client.get(&path).await?;
    print!("{}", reports::trajectory_predictions::table(&predictions).render());
    for TrajectoryPrediction { name, warnings, .. } in &predictions.predictions {
        for sentence in Warning::sentences(warnings, 1, "trajectories") {
            println!("warning: {name}: {sentence}");
        }
    }
    Ok(ExitCode::SUCCESS)
}

#[derive(Debug, Args)]
#[command(
    after_help = "Each line of standard input is a message, such as {\"open\": {}} and {\"step\": {\"u\": …, \"y\": …, \
                  \"future_u\": …}}; each line of standard output is the answer to one, in order. docs/prediction.md has all \
                  messages. The code is 1 if a message was refused."
)]
pub struct StreamArguments {
    /// The checkpoint, by its id or an alias; `torqued checkpoints` lists them
    #[arg(value_name = "CHECKPOINT")]
    checkpoint: Reference,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn stream(arguments: StreamArguments) -> anyhow::Result<ExitCode> {
    let mut stream = arguments.server.client()?.stream(&arguments.checkpoint).await?;
    // The server accepts no longer lines.
    let codec = LinesCodec::new_with_max_length(api::limits::QUESTION_BYTES);
    let mut lines = FramedRead::new(tokio::io::stdin(), codec);
    let mut refused = 0_u64;
    let mut count = 0_u64;
    loop {
        let line = tokio::select! {
            line = lines.next() => line,
            // An unexpected message is the end of the stream, and pings are answered meanwhile.
            end = stream.receive() => anyhow::bail!("the server said without being asked: {}", end?),
        };
        let Some(line) = line else { break };
        let line = line.with_context(|| format!("cannot read message {}", count + 1))?;
        if line.trim().is_empty() {
            continue;
        }
        stream.send(line).await?;
        let answer = stream.receive().await?;
        count += 1;
        refused += u64::from(is_refusal(&answer));
        println!("{answer}");
    }
    stream.close().await;
    if refused > 0 {
        eprintln!("{refused} of {count} messages were refused");
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

fn is_refusal(answer: &str) -> bool {
    matches!(serde_json::from_str(answer), Ok(StreamReply::Error(_)))
}

#[cfg(test)]
mod tests {
    use reqwest::StatusCode;

    use super::*;

    #[test]
    fn a_request_of_the_other_kind_is_told_the_flag() {
        let said = |field: &str, asks_for_torques: bool| {
            let refused = ClientError::Refused {
                status: StatusCode::UNPROCESSABLE_ENTITY,
                message: "not allowed".to_owned(),
                fields: vec![field.to_owned()],
            };
            with_flag(refused, asks_for_torques).to_string()
        };
        let motion = said("scenarios[0].motion", false);
        assert_eq!(motion, "not allowed; --torque asks for the torques of a motion");
        for field in ["scenarios[1].future_u", "scenarios[1].futures"] {
            assert!(said(field, true).contains("; without --torque, "), "{field}");
        }
        for (field, asks_for_torques) in
            [("scenarios[0].motion", true), ("scenarios[0].future_u", false), ("rate_hz", false)]
        {
            assert_eq!(said(field, asks_for_torques), "not allowed");
        }
    }
}
