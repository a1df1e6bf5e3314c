//! Tracking, compared with MLflow's own server on SQLite: points that many clients log at once, a
//! long curve, a long list of runs.

mod client;
mod logging;
mod mlflow;

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, ensure};
use serde_json::{Value, json};
use series::{measured_quantile, median};

use self::client::Client;
use self::logging::{BATCH, CLIENTS, Logged};
use self::mlflow::MlflowServer;
use super::measurement::{Goal, Measurement, Peer};
use super::queue::program::{Program, QueueLocation, SQLITE};
use super::serving::Serving;
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::places::target;
use crate::{peers, product};

/// Rounds in which both servers are measured in turn.
const ROUNDS: usize = 3;
/// 10 000 points of each client.
const BATCHES: u64 = 10;
/// MLflow's server gets fewer batches. It needs a minute and a half for these.
const BATCHES_OF_MLFLOW: u64 = 1;

const CURVE_POINTS: u64 = 1_000_000;
/// The number of points in a figure, and the largest number that the API gives.
const DRAWN: [u32; 2] = [500, 5000];
const RUNS: u32 = 10_000;
/// Number of measurements of each answer, after the first one.
const ASKED: usize = 40;

const GOAL_RATE: Goal = Goal::AtLeast(50.0);
const GOAL_MS: Goal = Goal::AtMost(100.0);

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    let torqued = product::build()?;
    let recorder = Program::new(product::build_example("queue_rates")?, []);
    let version = match wanted.peers {
        Peers::LeftOut => None,
        Peers::Measured => Some(mlflow::version()?),
    };
    let (mut measurements, refused) = log(&torqued, version.as_deref())?;
    let folder = folder()?;
    let reading = version.as_ref().map(|_| FilledMlflow::new(folder.path())).transpose()?;
    let theirs = reading.as_ref().zip(version.as_deref());
    measurements.extend(read(&torqued, &recorder, folder.path(), theirs)?);

    let batch = format!(
        "{BATCH} points a request, {CLIENTS} clients; every point is read back and compared"
    );
    let mut notes = vec![batch, format!("medians of {ROUNDS} rounds, in turn")];
    if version.is_some() {
        notes.push(format!(
            "MLflow's server as `mlflow server --backend-store-uri sqlite:///...` starts it, with {} points a client; \
             it refused {refused} requests, which were sent again",
            BATCHES_OF_MLFLOW * BATCH,
        ));
    }
    Ok(BenchmarkResults { notes, measurements })
}

fn folder() -> anyhow::Result<tempfile::TempDir> {
    Ok(tempfile::Builder::new().prefix("bench-metrics-").tempdir_in(target())?)
}

/// Points per second, and the number of requests that MLflow's server refused.
fn log(torqued: &Path, version: Option<&str>) -> anyhow::Result<(Vec<Measurement>, u64)> {
    let (mut ours, mut theirs, mut refused) = (Vec::new(), Vec::new(), 0);
    for round in 1..=ROUNDS {
        eprintln!("logging, round {round}");
        let folder = folder()?;
        let server = Serving::start(torqued, &folder.path().join("data"), 0)?;
        let Logged { per_second, refused: of_us } = logging::log(&server.url, BATCHES)?;
        ensure!(of_us == 0, "torqued refused {of_us} requests");
        ours.push(per_second);
        drop(server);
        if version.is_some() {
            let server = MlflowServer::start(folder.path())?;
            let logged = logging::log(&server.url, BATCHES_OF_MLFLOW)?;
            theirs.push(logged.per_second);
            refused += logged.refused;
        }
    }
    let peer = version.map(|version| Peer { value: median(theirs), version: version.to_owned() });
    let what = format!("points logged by {CLIENTS} clients");
    let rate = Measurement::compared(what, median(ours), peer, "1/s", Some(GOAL_RATE));
    Ok((vec![rate], refused))
}

/// MLflow's server with a long curve and many runs.
struct FilledMlflow {
    server: MlflowServer,
    /// The run of the curve.
    run: String,
}

impl FilledMlflow {
    fn new(folder: &Path) -> anyhow::Result<Self> {
        eprintln!("filling MLflow's database");
        // A first start creates the tables.
        drop(MlflowServer::start(folder)?);
        let script = crate::places::repository().join("tests/peers/mlflow_fill.py");
        let output = Command::new(peers::mlflow()?)
            .arg(script)
            .arg(mlflow::database(folder))
            .args([CURVE_POINTS.to_string(), RUNS.to_string()])
            .output()?;
        ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let run = String::from_utf8(output.stdout)?.trim().to_owned();
        Ok(Self { server: MlflowServer::start(folder)?, run })
    }
}

fn read(
    torqued: &Path,
    recorder: &Program,
    folder: &Path,
    theirs: Option<(&FilledMlflow, &str)>,
) -> anyhow::Result<Vec<Measurement>> {
    eprintln!("recording {RUNS} runs, one with {CURVE_POINTS} points");
    let place = QueueLocation { folder: folder.join("data"), database: SQLITE.to_owned() };
    let run = recorder.run("runs", &place, &[&RUNS.to_string(), &CURVE_POINTS.to_string()])?;
    let server = Serving::start(torqued, &place.folder, 0)?;
    let client = Client::new(&server.url);
    let mut rows = Vec::new();

    for points in DRAWN {
        eprintln!("a curve in {points} points");
        let path = format!("/v1/runs/{}/metrics/train%2Floss?points={points}", run.trim());
        let times = times_ms(&client, |client| {
            let answer: Value = serde_json::from_str(&client.get(&path)?)?;
            let shown = answer["points"].as_array().map_or(0, Vec::len);
            let is_whole = answer["recorded"] == json!(CURVE_POINTS);
            let limit = usize::try_from(points)?;
            ensure!(is_whole && (limit / 2..=limit).contains(&shown), "{shown} points of {points}");
            Ok(())
        })?;
        let peer = match theirs {
            // The page of MLflow's server asks for at most 2500 points.
            Some((mlflow, version)) if points <= 2500 => {
                Some((mlflow_curve(mlflow, points)?, version))
            }
            _ => None,
        };
        rows.extend(quantiles(&format!("10^6 points drawn in {points}"), &times, peer.as_ref()));
    }

    eprintln!("lists of {RUNS} runs");
    let times = times_ms(&client, |client| page_of_runs(client, "/v1/runs?limit=500", 500))?;
    rows.extend(quantiles("a page of 500 of 10^4 runs, /v1", &times, None));
    let times = times_ms(&client, |client| search(client, "1", 1000))?;
    let what = "a page of 1000 of 10^4 own runs, MLflow's search, p95";
    rows.push(Measurement::alone(what, measured_quantile(&times, 0.95), "ms", None));
    track(&client)?;
    let times = times_ms(&client, |client| search(client, "0", 1000))?;
    let peer = match theirs {
        Some((mlflow, version)) => {
            let client = Client::new(&mlflow.server.url);
            Some((times_ms(&client, |client| search(client, "0", 1000))?, version))
        }
        None => None,
    };
    rows.extend(quantiles("a page of 1000 of 10^4 runs, MLflow's search", &times, peer.as_ref()));
    Ok(rows)
}

/// Logs runs like clients of MLflow, with five metrics each and with the params in the peer's
/// database.
fn track(client: &Client) -> anyhow::Result<()> {
    const KEYS: [&str; 5] = ["loss", "rmse", "rmse_deg", "seconds", "samples"];
    eprintln!("logging {RUNS} runs");
    for number in 0..RUNS {
        let run = client.begin_run(&format!("run-{number}"))?;
        let metric = |key| json!({"key": key, "value": number, "timestamp": 1, "step": 1});
        let param = |key| json!({"key": key, "value": (number % 9).to_string()});
        let body = json!({
            "run_id": run,
            "metrics": KEYS.map(metric),
            "params": KEYS.map(param),
        });
        client.post_until_accepted("/api/2.0/mlflow/runs/log-batch", &body.to_string())?;
    }
    Ok(())
}

/// The median with the peer's, and the quantile that has a goal.
fn quantiles(what: &str, times: &[f64], peer: Option<&(Vec<f64>, &str)>) -> [Measurement; 2] {
    [("p50", 0.5, None), ("p95", 0.95, Some(GOAL_MS))].map(|(name, at, goal)| {
        let ours = measured_quantile(times, at);
        let name = format!("{what}, {name}");
        let mut row = Measurement::alone(&name, ours, "ms", goal);
        if let Some((theirs, version)) = peer {
            let peer =
                Peer { value: measured_quantile(theirs, at), version: (*version).to_owned() };
            let met = row.met;
            row = Measurement {
                goal,
                met,
                ..Measurement::compared(name, ours, Some(peer), "ms", None)
            };
        }
        row
    })
}

/// The times of the page's own route, which gives points at equal distances.
fn mlflow_curve(mlflow: &FilledMlflow, points: u32) -> anyhow::Result<Vec<f64>> {
    let path = format!(
        "/ajax-api/2.0/mlflow/metrics/get-history-bulk-interval?run_ids={}&metric_key=loss&max_results={points}",
        mlflow.run
    );
    times_ms(&Client::new(&mlflow.server.url), |client| {
        let answer: Value = serde_json::from_str(&client.get(&path)?)?;
        let shown = answer["metrics"].as_array().map_or(0, Vec::len);
        ensure!(shown > 0, "MLflow shows no points");
        Ok(())
    })
}

fn page_of_runs(client: &Client, path: &str, expected: usize) -> anyhow::Result<()> {
    let answer: Value = serde_json::from_str(&client.get(path)?)?;
    let found = answer["runs"].as_array().context("no runs")?.len();
    ensure!(found == expected, "{found} runs in place of {expected}");
    Ok(())
}

fn search(client: &Client, experiment: &str, expected: usize) -> anyhow::Result<()> {
    let body = json!({"experiment_ids": [experiment], "max_results": expected}).to_string();
    let (status, text) = client.post("/api/2.0/mlflow/runs/search", &body)?;
    ensure!(status == 200, "status {status}: {text}");
    let answer: Value = serde_json::from_str(&text)?;
    let found = answer["runs"].as_array().context("no runs")?.len();
    ensure!(found == expected, "{found} runs in place of {expected}");
    Ok(())
}

/// The times of several requests in ms, in rising order. The first request does not count.
fn times_ms(
    client: &Client,
    ask: impl Fn(&Client) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<f64>> {
    ask(client)?;
    let mut times = Vec::new();
    for _ in 0..ASKED {
        let began = Instant::now();
        ask(client)?;
        times.push(began.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times)
}
