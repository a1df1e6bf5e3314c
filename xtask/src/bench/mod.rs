//! `cargo xtask bench NAME`: the command for every benchmark.

mod arms;
mod build;
mod control;
mod dynamics;
mod identify;
mod inference;
pub mod isa;
mod measurement;
mod metrics;
mod million;
mod networks;
mod objects;
mod parquet;
mod peak;
mod queue;
mod quickstart;
mod scale;
mod serving;
mod training;
mod wanted;

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use clap::builder::PossibleValuesParser;
use simd::InstructionSet;

use crate::machine;
pub use build::instead_of_rustc;
use wanted::{BenchmarkResults, Peers, Size, Wanted};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Benchmark to run
    #[arg(value_parser = PossibleValuesParser::new(ALL.map(|benchmark| benchmark.name)))]
    name: String,

    /// Measure the programs that we compare ourselves with, too, in the same session
    #[arg(long)]
    peers: bool,

    /// Measure only networks of this size
    #[arg(long, value_name = "SIZE")]
    size: Option<Size>,

    /// Rounds for every network of `training` and `inference`; medians of few are less reliable
    #[arg(long, value_name = "COUNT")]
    rounds: Option<NonZeroUsize>,

    /// Instruction set for us and our peers instead of the fastest, such as avx2
    #[arg(long, value_name = "SET")]
    isa: Option<InstructionSet>,

    /// File for the measurements
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

struct Benchmark {
    name: &'static str,
    about: &'static str,
    run: fn(Wanted) -> anyhow::Result<BenchmarkResults>,
}

const ALL: [Benchmark; 13] = [
    Benchmark {
        name: "arms",
        about: "forward dynamics per second of arms from URDFs, beside Pinocchio",
        run: arms::run,
    },
    Benchmark {
        name: "build",
        about: "seconds and processor time of a first build, and of the crates that take longest",
        run: build::run,
    },
    Benchmark {
        name: "control",
        about: "milliseconds from a measured sample to the prediction, over a WebSocket",
        run: control::run,
    },
    Benchmark {
        name: "dynamics",
        about: "forward dynamics and trajectories per second, beside Pinocchio and MuJoCo; a million \
                trajectories written",
        run: dynamics::run,
    },
    Benchmark {
        name: "identify",
        about: "errors, processor time and memory of identifications from logs, beside mujoco.sysid, which takes an hour",
        run: identify::run,
    },
    Benchmark {
        name: "inference",
        about: "milliseconds of a prediction of every network, beside PyTorch",
        run: inference::run,
    },
    Benchmark {
        name: "metrics",
        about: "points logged per second by 64 clients, a curve of 10^6 points, lists of 10^4 runs; beside MLflow's server",
        run: metrics::run,
    },
    Benchmark {
        name: "objects",
        about: "bytes per second into and out of a folder, and of a bucket",
        run: objects::run,
    },
    Benchmark {
        name: "parquet",
        about: "writing and reading trajectories, beside pyarrow and polars",
        run: parquet::run,
    },
    Benchmark {
        name: "queue",
        about: "tasks claimed per second, from submit to start, idle workers; beside apalis and Graphile Worker",
        run: queue::run,
    },
    Benchmark {
        name: "quickstart",
        about: "seconds per stage of `torqued quickstart`, then of a second run",
        run: quickstart::run,
    },
    Benchmark {
        name: "scale",
        about: "10^4 jobs and 100 workers on PostgreSQL, measured with tasks that do nothing and simulated with tasks that \
                last",
        run: scale::run,
    },
    Benchmark {
        name: "training",
        about: "milliseconds and memory of a training step of every network, beside PyTorch",
        run: training::run,
    },
];

pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let benchmark = ALL
        .iter()
        .find(|benchmark| benchmark.name == arguments.name)
        .with_context(|| format!("there is no benchmark {:?}", arguments.name))?;
    if let Some(instructions) = arguments.isa
        && let Some(code) = isa::again(instructions)?
    {
        return Ok(code);
    }
    eprintln!("{}: {}", benchmark.name, benchmark.about);
    let peers = if arguments.peers { Peers::Measured } else { Peers::LeftOut };
    let machine = machine::description();
    let wanted = Wanted { peers, size: arguments.size, rounds: arguments.rounds };
    let BenchmarkResults { notes, measurements } = (benchmark.run)(wanted)?;
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

/// The command line for the same run.
fn command_line(arguments: &Arguments) -> String {
    let peers = if arguments.peers { " --peers" } else { "" };
    let size = match arguments.size {
        None => "",
        Some(Size::Small) => " --size small",
        Some(Size::Paper) => " --size paper",
    };
    let rounds = arguments.rounds.map_or_else(String::new, |count| format!(" --rounds {count}"));
    let isa = arguments.isa.map_or_else(String::new, |set| format!(" --isa {set}").to_lowercase());
    format!("cargo xtask bench {}{peers}{size}{rounds}{isa}", arguments.name)
}
