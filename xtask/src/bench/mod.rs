//! `cargo xtask bench NAME`: the one door to every benchmark.

mod measurement;
mod quickstart;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Args;
use clap::builder::PossibleValuesParser;

use crate::process::{self, command};
use measurement::Measurement;

#[derive(Debug, Args)]
pub struct Arguments {
    /// What to measure
    #[arg(value_parser = PossibleValuesParser::new(ALL.map(|benchmark| benchmark.name)))]
    name: String,

    /// Measure what we compare ourselves with, too, in the same sitting
    #[arg(long)]
    peers: bool,

    /// Write the measurements here
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

struct Benchmark {
    name: &'static str,
    about: &'static str,
    run: fn(Peers) -> anyhow::Result<Vec<Measurement>>,
}

/// Whether other programs are measured beside ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Peers {
    LeftOut,
    Measured,
}

const ALL: [Benchmark; 1] = [Benchmark {
    name: "quickstart",
    about: "seconds per stage of `torqued quickstart`, then of a second run",
    run: quickstart::run,
}];

pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let benchmark = ALL
        .iter()
        .find(|benchmark| benchmark.name == arguments.name)
        .with_context(|| format!("there is no benchmark {:?}", arguments.name))?;
    eprintln!("{}: {}", benchmark.name, benchmark.about);
    let peers = if arguments.peers { Peers::Measured } else { Peers::LeftOut };
    let measurements = (benchmark.run)(peers)?;
    print!("{}", measurement::table(&measurements));
    if let Some(file) = &arguments.json {
        let json = serde_json::to_string_pretty(&measurements)?;
        std::fs::write(file, json + "\n")
            .with_context(|| format!("cannot write {}", file.display()))?;
    }
    let missed = measurements.iter().any(|measurement| measurement.met == Some(false));
    Ok(if missed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// Builds the program in the profile it is shipped in.
fn build_torqued() -> anyhow::Result<PathBuf> {
    let built = process::run(&mut command("cargo", &["build", "--release", "--bin", "torqued"]))?;
    ensure!(built.success, "torqued does not build");
    Ok(crate::repository().join("target/release/torqued"))
}
