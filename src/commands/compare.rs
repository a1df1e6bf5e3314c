//! Runs beside each other.

use std::process::ExitCode;

use clap::Args;
use reports::comparison::{self, Compared};
use serde::Deserialize;
use serde_json::Value;
use wire::{Run, RunName};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Two runs or more: ids, which `torqued runs` lists, and identifiers of runs that clients of MLflow logged
    #[arg(value_name = "RUN", required = true, num_args = 2..=api::limits::COMPARED_RUNS)]
    runs: Vec<RunName>,

    /// Show parameters that all runs share, too
    #[arg(long)]
    all: bool,

    /// Print CSV
    #[arg(long, conflicts_with = "json")]
    csv: bool,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let mut answers: Vec<Value> = Vec::new();
    let mut runs: Vec<Compared> = Vec::new();
    for name in arguments.runs {
        let path = match &name {
            RunName::Own(id) => format!("/v1/runs/{id}"),
            RunName::Logged(id) => format!("/api/2.0/mlflow/runs/get?run_id={id}"),
        };
        let answer: Value = client.get(&path).await?;
        runs.push(match name {
            RunName::Own(_) => Compared::from(&Run::deserialize(&answer)?),
            RunName::Logged(_) => Logged::deserialize(&answer)?.compared(),
        });
        answers.push(answer);
    }
    if arguments.output.json {
        write_json(&answers)?;
        return Ok(ExitCode::SUCCESS);
    }
    let tables = [comparison::metrics(&runs), comparison::parameters(&runs, arguments.all)];
    for table in tables.iter().filter(|table| !table.rows.is_empty()) {
        if arguments.csv {
            print!("{}", table.to_csv()?);
        } else {
            print!("{}", table.with_title());
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// MLflow's answer about a run, as far as it is compared.
#[derive(Deserialize)]
struct Logged {
    run: LoggedRun,
}

#[derive(Deserialize)]
struct LoggedRun {
    info: Info,
    data: Data,
}

#[derive(Deserialize)]
struct Info {
    run_id: String,
    run_name: String,
}

#[derive(Deserialize)]
struct Data {
    #[serde(default)]
    metrics: Vec<Pair<Value>>,
    #[serde(default)]
    params: Vec<Pair<String>>,
}

#[derive(Deserialize)]
struct Pair<V> {
    key: String,
    value: V,
}

impl Logged {
    fn compared(&self) -> Compared {
        let Self { run: LoggedRun { info, data } } = self;
        let params = data.params.iter().map(|pair| (pair.key.as_str(), pair.value.as_str()));
        // Infinity and NaN are texts.
        let number = |value: &Value| match value {
            Value::String(text) => text.parse().unwrap_or(f64::NAN),
            value => value.as_f64().unwrap_or(f64::NAN),
        };
        let metrics = data.metrics.iter().map(|pair| (pair.key.as_str(), number(&pair.value)));
        Compared::logged(&info.run_name, &info.run_id, params, metrics)
    }
}
