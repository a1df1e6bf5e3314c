//! Seconds per stage of the quickstart, from the job times that the server records.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, ensure};
use serde::Deserialize;

use super::measurement::{Goal, Measurement};
use super::serving::Serving;
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::{process, product};

/// The whole quickstart on two cores without a GPU, in seconds.
const GOAL_FIRST: Goal = Goal::AtMost(60.0);
/// A second run, which has nothing to compute.
const GOAL_SECOND: Goal = Goal::AtMost(10.0);

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    if wanted.peers == Peers::Measured {
        eprintln!("no other program does what the quickstart does: nothing to compare with");
    }
    let torqued = product::build()?;
    let data = tempfile::Builder::new().prefix("torqued-bench-").tempdir()?;
    let first = quickstart(&torqued, data.path())?;
    let second = quickstart(&torqued, data.path())?;
    let mut measurements: Vec<Measurement> = stages(&torqued, data.path())?
        .into_iter()
        .map(|(stage, seconds)| Measurement::alone(stage, seconds, "s", None))
        .collect();
    measurements.push(Measurement::alone("first run", first, "s", Some(GOAL_FIRST)));
    measurements.push(Measurement::alone("second run", second, "s", Some(GOAL_SECOND)));
    Ok(BenchmarkResults { notes: Vec::new(), measurements })
}

/// Seconds that one quickstart takes, from start to exit.
fn quickstart(torqued: &Path, data: &Path) -> anyhow::Result<f64> {
    let started = Instant::now();
    let mut command = Command::new(torqued);
    command.args(["quickstart", "--exit", "--listen", "127.0.0.1:0", "--data"]).arg(data);
    let finished = process::run(&mut command)?;
    ensure!(finished.success, "quickstart failed");
    Ok(started.elapsed().as_secs_f64())
}

#[derive(Deserialize)]
struct JobList {
    jobs: Vec<Job>,
}

#[derive(Deserialize)]
struct Job {
    id: i64,
    kind: String,
    duration_seconds: Option<f64>,
    #[serde(default)]
    members: Vec<Member>,
}

#[derive(Deserialize)]
struct Member {
    name: String,
    job: i64,
}

/// Seconds that each job of the pipeline took.
fn stages(torqued: &Path, data: &Path) -> anyhow::Result<Vec<(String, f64)>> {
    let server = Serving::start(torqued, data, 0)?;
    let mut jobs = Command::new(torqued);
    let list: JobList =
        super::dynamics::answer(jobs.args(["jobs", "--json", "--server", &server.url]))?;
    let pipeline = list.jobs.iter().find(|job| job.kind == "pipeline").context("no pipeline")?;
    pipeline
        .members
        .iter()
        .map(|member| {
            let job = list.jobs.iter().find(|job| job.id == member.job);
            let seconds = job.and_then(|job| job.duration_seconds);
            let seconds = seconds.with_context(|| format!("job {} did not finish", member.job))?;
            Ok((member.name.clone(), seconds))
        })
        .collect()
}
