//! Runs in somebody's MLflow server: params, metrics with their history, tags and files, over its REST API.

mod entities;
mod error;
mod files;
mod run;
mod server;
mod source;

use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::ensure;
use clap::{ArgGroup, Args};
use serde_json::Value;

use self::run::{Exported, Exporter, Outcome};
use self::server::{Login, MlflowServer};
use self::source::Selection;
use crate::client::Client;
use crate::exit::INTERRUPTED;
use crate::output::write_json;
use crate::progress::{Part, follow_parts};

pub use self::error::MlflowError;

#[derive(Debug, Args)]
#[command(group(ArgGroup::new("which").requires("mlflow").args(["runs", "all", "filter"])))]
pub struct MlflowArguments {
    /// With --mlflow: the experiment that the runs go to; made if missing
    #[arg(long, value_name = "NAME", default_value = "torqued")]
    experiment: String,

    /// With --mlflow: this run; may be repeated
    #[arg(long = "run", value_name = "RUN")]
    runs: Vec<i64>,

    /// With --mlflow: all runs
    #[arg(long)]
    all: bool,

    /// With --mlflow: the runs that a filter of MLflow finds, such as "tags.torqued.kind = 'train'"
    #[arg(long, value_name = "FILTER")]
    filter: Option<String>,

    /// With --mlflow: leave out reports, figures and checkpoints
    #[arg(long, requires = "mlflow")]
    without_files: bool,

    /// User of the MLflow server
    #[arg(long, env = "MLFLOW_TRACKING_USERNAME", value_name = "NAME")]
    mlflow_username: Option<String>,

    /// The user's password
    #[arg(long, env = "MLFLOW_TRACKING_PASSWORD", value_name = "PASSWORD", hide_env_values = true)]
    mlflow_password: Option<String>,

    /// Token of the MLflow server
    #[arg(long, env = "MLFLOW_TRACKING_TOKEN", value_name = "TOKEN", hide_env_values = true)]
    mlflow_token: Option<String>,
}

impl MlflowArguments {
    /// As MLflow's client has it: a user with a password goes before a token.
    fn login(&mut self) -> Login {
        let given = |text: &mut Option<String>| text.take().filter(|text| !text.is_empty());
        let password = given(&mut self.mlflow_password).unwrap_or_default();
        match (given(&mut self.mlflow_username), given(&mut self.mlflow_token)) {
            (Some(username), _) => Login::Password { username, password },
            (None, Some(token)) => Login::Token(token),
            (None, None) => Login::Nobody,
        }
    }

    fn selection(&mut self) -> anyhow::Result<Selection> {
        let filter = self.filter.take();
        ensure!(
            self.all || filter.is_some() || !self.runs.is_empty(),
            "--mlflow needs to know which runs: give --run ID, --filter FILTER or --all"
        );
        Ok(match filter {
            Some(filter) => Selection::Filter(filter),
            None if self.all => Selection::All,
            None => Selection::Runs(std::mem::take(&mut self.runs)),
        })
    }
}

/// Writes the runs to the MLflow server at `address`.
pub async fn export(
    client: &Client,
    address: &str,
    mut arguments: MlflowArguments,
    is_json: bool,
) -> anyhow::Result<ExitCode> {
    let selection = arguments.selection()?;
    let server = MlflowServer::new(address, arguments.login())?;
    let files = if arguments.without_files { files::Choice::LeftOut } else { files::Choice::Sent };
    let (done, total) = (AtomicU64::new(0), AtomicU64::new(1));
    let work = async {
        refuse_itself(client, &server).await?;
        let experiment = server.experiment(&arguments.experiment).await?;
        let exporter = Exporter { client, server: &server, experiment: &experiment, files };
        let ids = source::selected(client, selection).await?;
        total.store(ids.len() as u64, Ordering::Relaxed);
        let mut outcomes = Vec::new();
        for id in ids {
            outcomes.push(exporter.export(id).await?);
            done.fetch_add(1, Ordering::Relaxed);
        }
        Ok::<_, anyhow::Error>(outcomes)
    };
    let parts = || {
        let [done, total] = [&done, &total].map(|count| count.load(Ordering::Relaxed));
        vec![Part { name: "export", unit: "runs", done, total }]
    };
    let Some(ended) = follow_parts(work, parts).await? else {
        eprintln!("interrupted; the command goes on when it is repeated");
        return Ok(ExitCode::from(INTERRUPTED));
    };
    let mut exported = Vec::new();
    for outcome in ended? {
        match outcome {
            Outcome::LeftOut(reason) => eprintln!("warning: {reason}"),
            Outcome::Exported(run) => {
                run.notes.iter().for_each(|note| eprintln!("warning: {note}"));
                exported.push(run);
            }
        }
    }
    if is_json {
        exported.iter().try_for_each(write_json)?;
    } else {
        println!("{}", said(&exported, &arguments.experiment, &server.shown()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Refuses to export runs to the torqued server that has them: it answers as an MLflow server does,
/// and would keep each run twice. Its experiment of own runs is as old as its database.
async fn refuse_itself(client: &Client, server: &MlflowServer) -> anyhow::Result<()> {
    let identity = |experiment: &Value| {
        ["experiment_id", "creation_time", "artifact_location"].map(|key| experiment[key].clone())
    };
    let (here, there) =
        (source::experiment(client).await?, server.find_experiment(source::EXPERIMENT).await?);
    ensure!(
        identity(&here) != identity(&there),
        "--mlflow is {}, the torqued server that has these runs already; allowed: another server",
        server.shown()
    );
    Ok(())
}

fn said(runs: &[Exported], experiment: &str, server: &str) -> String {
    let created = runs.iter().filter(|run| run.created).count();
    let points: usize = runs.iter().map(|run| run.points).sum();
    let files: usize = runs.iter().map(|run| run.files).sum();
    format!(
        "{} runs in experiment {experiment} of {server}, {created} of them new; {points} points and {files} files were sent",
        runs.len()
    )
}
