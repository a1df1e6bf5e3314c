use std::num::NonZero;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use spec::{JobSpec, SimulateSpec};
use worker::DatasetFolder;

use crate::commands::submit::{MAX_SPEC_BYTES, read_json};
use crate::progress::{self, OwnWork, ProgressCallback, measure};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job as JSON, with kind simulate; `-` reads standard input
    #[arg(long, value_name = "FILE")]
    spec: PathBuf,

    /// Folder for the dataset; a partial dataset there is completed
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// Threads to compute with [default: the machine's]
    #[arg(long, value_name = "N")]
    threads: Option<NonZero<usize>>,
}

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let spec = simulation(&read_json(&arguments.spec, MAX_SPEC_BYTES)?)?;
    for doubt in spec.doubts() {
        eprintln!("warning: {doubt}");
    }
    compute_with(arguments.threads)?;
    let mut folder = DatasetFolder::begin(&arguments.out, &spec)?;
    let work = move |progress: ProgressCallback<'_>| folder.complete(progress).map(|()| folder);
    let folder =
        progress::follow_own(OwnWork::on_trajectories("simulate", spec.trajectories), work)
            .await??;
    let description = folder.description();
    let bytes: u64 =
        description.shards.iter().flat_map(|shard| &shard.files).map(|file| file.size).sum();
    let megabytes = bytes as f64 / 1e6;
    println!(
        "{} trajectories in {}, {megabytes:.1} MB; dataset {}",
        measure::count(description.trajectories),
        arguments.out.display(),
        description.digest,
    );
    Ok(ExitCode::SUCCESS)
}

fn simulation(text: &[u8]) -> anyhow::Result<SimulateSpec> {
    match spec::parse(text)? {
        JobSpec::Simulate(spec) => Ok(spec),
        other => bail!("kind is {}, allowed: simulate", other.kind()),
    }
}

/// Sets the number of threads with which this process computes.
pub fn compute_with(threads: Option<NonZero<usize>>) -> anyhow::Result<()> {
    let Some(threads) = threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.get())
        .build_global()
        .with_context(|| format!("cannot start {threads} threads"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_simulation_can_be_simulated() {
        assert_eq!(simulation(br#"{"preset": "D1-chirp"}"#).unwrap().trajectories, 350_000);
        let error = simulation(br#"{"preset": "quickstart"}"#).unwrap_err().to_string();
        assert_eq!(error, "kind is pipeline, allowed: simulate");
    }
}
