//! `cargo xtask bench NAME`: the one door to every benchmark.

mod dynamics;
mod measurement;
mod million;
mod parquet;
mod quickstart;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use clap::builder::PossibleValuesParser;

use crate::machine;
use measurement::{Goal, Measurement, Peer, median};

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
    run: fn(Peers) -> anyhow::Result<Report>,
}

/// What a benchmark has to say.
struct Report {
    /// What was run, in which version, on what.
    notes: Vec<String>,
    measurements: Vec<Measurement>,
}

/// Whether other programs are measured beside ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Peers {
    LeftOut,
    Measured,
}

const ALL: [Benchmark; 3] = [
    Benchmark {
        name: "dynamics",
        about: "forward dynamics and trajectories per second, beside Pinocchio and MuJoCo; a million \
                trajectories written",
        run: dynamics::run,
    },
    Benchmark {
        name: "parquet",
        about: "writing and reading trajectories, beside pyarrow and polars",
        run: parquet::run,
    },
    Benchmark {
        name: "quickstart",
        about: "seconds per stage of `torqued quickstart`, then of a second run",
        run: quickstart::run,
    },
];

pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let benchmark = ALL
        .iter()
        .find(|benchmark| benchmark.name == arguments.name)
        .with_context(|| format!("there is no benchmark {:?}", arguments.name))?;
    eprintln!("{}: {}", benchmark.name, benchmark.about);
    let peers = if arguments.peers { Peers::Measured } else { Peers::LeftOut };
    let machine = machine::description();
    let Report { notes, measurements } = (benchmark.run)(peers)?;
    println!("{}\n{machine}", command_line(arguments));
    for note in notes {
        println!("{note}");
    }
    println!();
    print!("{}", measurement::table(&measurements));
    if let Some(file) = &arguments.json {
        let json = serde_json::to_string_pretty(&measurements)?;
        std::fs::write(file, json + "\n")
            .with_context(|| format!("cannot write {}", file.display()))?;
    }
    let missed = measurements.iter().any(|measurement| measurement.met == Some(false));
    Ok(if missed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// As one would type it.
fn command_line(arguments: &Arguments) -> String {
    let peers = if arguments.peers { " --peers" } else { "" };
    format!("cargo xtask bench {}{peers}", arguments.name)
}
