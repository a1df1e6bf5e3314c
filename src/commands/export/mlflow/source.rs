//! The runs of torqued's server, which shows them in MLflow's terms.

use anyhow::Context;
use reqwest::Url;
use serde::Deserialize;
use serde_json::{Value, json};
use wire::{Checkpoint, Job, StoredFile};

use super::entities::{Point, Run};
use crate::client::{Client, ClientError};

/// The experiment that has torqued's own runs, and what their ids begin with.
pub const EXPERIMENT: &str = "torqued";
const OWN: &str = "torqued-";

/// Runs of a page of a search.
const PAGE: u32 = 500;

/// The runs to export.
pub enum Selection {
    All,
    Filter(String),
    Runs(Vec<i64>),
}

#[derive(Deserialize)]
struct RunPage {
    #[serde(default)]
    runs: Vec<Run>,
    next_page_token: Option<String>,
}

#[derive(Deserialize)]
struct History {
    #[serde(default)]
    metrics: Vec<Point>,
    next_page_token: Option<String>,
}

/// The ids of the wanted runs, oldest first.
pub async fn selected(client: &Client, selection: Selection) -> anyhow::Result<Vec<i64>> {
    let filter = match selection {
        Selection::Runs(ids) => return Ok(ids),
        Selection::All => String::new(),
        Selection::Filter(filter) => filter,
    };
    let experiment = &experiment(client).await?["experiment_id"];
    let mut ids = Vec::new();
    let mut token: Option<String> = None;
    loop {
        let question = json!({
            "experiment_ids": [experiment],
            "filter": filter,
            "order_by": ["attributes.start_time ASC"],
            "max_results": PAGE,
            "page_token": token,
        });
        let page: RunPage = client.ask("/api/2.0/mlflow/runs/search", &question).await?;
        ids.extend(page.runs.iter().filter_map(|run| own_id(&run.info.run_id)));
        token = page.next_page_token;
        if token.is_none() {
            return Ok(ids);
        }
    }
}

/// The experiment of torqued's own runs.
pub async fn experiment(client: &Client) -> anyhow::Result<Value> {
    let path = address("experiments/get-by-name", &[("experiment_name", EXPERIMENT)])?;
    Ok(client.get::<Value>(&path).await?["experiment"].take())
}

/// A run as MLflow's clients see it.
pub async fn run(client: &Client, id: i64) -> anyhow::Result<Run> {
    #[derive(Deserialize)]
    struct RunResponse {
        run: Run,
    }
    let address = address("runs/get", &[("run_id", &format!("{OWN}{id}"))])?;
    Ok(client.get::<RunResponse>(&address).await?.run)
}

/// All points of a metric.
pub async fn history(client: &Client, id: i64, key: &str) -> anyhow::Result<Vec<Point>> {
    let run = format!("{OWN}{id}");
    let mut points = Vec::new();
    let mut token: Option<String> = None;
    loop {
        let mut query = vec![("run_id", run.as_str()), ("metric_key", key)];
        query.extend(token.iter().map(|token| ("page_token", token.as_str())));
        let mut page: History = client.get(&address("metrics/get-history", &query)?).await?;
        points.append(&mut page.metrics);
        token = page.next_page_token;
        if token.is_none() {
            return Ok(points);
        }
    }
}

/// The files of a run by the names that MLflow's clients see: those that it left, and those of its checkpoints.
pub async fn files(
    client: &Client,
    run: &wire::Run,
) -> Result<Vec<(String, StoredFile)>, ClientError> {
    let mut files: Vec<(String, StoredFile)> = Vec::new();
    for artifact in &run.artifacts {
        let wire::Artifact { name, size, sha256, url, .. } = artifact.clone();
        let plain = name.rsplit('/').next().unwrap_or_default().to_owned();
        files.push((name, StoredFile { name: plain, size, sha256, url }));
    }
    let job: Job = client.job(run.job).await?;
    for id in job.checkpoints {
        let Checkpoint { step, files: of_checkpoint, .. } = client.checkpoint(id).await?;
        for file in of_checkpoint {
            files.push((format!("checkpoints/step-{step:08}/{}", file.name), file));
        }
    }
    Ok(files)
}

fn own_id(run: &str) -> Option<i64> {
    run.strip_prefix(OWN)?.parse().ok()
}

fn address(path: &str, query: &[(&str, &str)]) -> anyhow::Result<String> {
    let mut url = Url::parse("http://localhost").context("no address")?;
    url.query_pairs_mut().extend_pairs(query);
    Ok(format!("/api/2.0/mlflow/{path}?{}", url.query().unwrap_or_default()))
}
