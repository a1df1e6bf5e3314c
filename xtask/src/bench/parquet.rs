//! Writing and reading the trajectories of a shard, compared with pyarrow and polars.
//!
//! All run on one thread. Rates are in MB of plain columns per second, so that they do not depend
//! on the compression. Writing ends when the file is on the disk.

use std::path::Path;
use std::process::Command;

use serde::Deserialize;
use serde_json::json;
use series::median;

use super::dynamics::answer;
use super::measurement::{Measurement, Peer};
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::places::target;
use crate::{peers, product};

const ROUNDS: usize = 5;

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    let example = product::build_example("parquet_rates")?;
    let torqued = product::build()?;
    let python = match wanted.peers {
        Peers::LeftOut => None,
        Peers::Measured => Some(peers::python()?),
    };
    let folder = tempfile::Builder::new().prefix("bench-parquet-").tempdir_in(target())?;
    let spec = folder.path().join("spec.json");
    // One shard of the usual size.
    let mut simulation = super::dynamics::spec(10_000);
    simulation["shard_trajectories"] = json!(10_000);
    std::fs::write(&spec, simulation.to_string())?;
    let dataset = folder.path().join("dataset");
    product::simulate_anew(&torqued, &spec, &dataset)?;
    let file = dataset.join("trajectories-00000.parquet");

    let mut rounds = Vec::new();
    for round in 1..=ROUNDS {
        eprintln!("round {round} of {ROUNDS}");
        let ours = answer(Command::new(&example).arg(&file))?;
        let theirs = python.as_deref().map(|python| measure_peers(python, &file)).transpose()?;
        rounds.push(Round { ours, theirs });
    }
    let notes = vec![
        format!("simulated: {simulation}"),
        format!("medians of {ROUNDS} rounds, one thread each"),
    ];
    Ok(BenchmarkResults { notes, measurements: compare(&rounds) })
}

/// The output of `store/examples/parquet_rates.rs`.
#[derive(Clone, Debug, Deserialize)]
struct Ours {
    /// Bytes of the columns in memory.
    raw_bytes: u64,
    file_bytes: u64,
    write_s: f64,
    read_s: f64,
}

/// The output of `tests/peers/parquet_rates.py`.
#[derive(Clone, Debug, Deserialize)]
struct Theirs {
    pyarrow: String,
    polars: String,
    file_bytes: u64,
    pyarrow_write_s: f64,
    pyarrow_read_s: f64,
    /// Time to read the file that our program wrote. The next field is alike.
    pyarrow_read_ours_s: f64,
    polars_read_ours_s: f64,
}

struct Round {
    ours: Ours,
    theirs: Option<Theirs>,
}

fn measure_peers(python: &Path, file: &Path) -> anyhow::Result<Theirs> {
    let mut command = Command::new(python);
    command.env("POLARS_MAX_THREADS", "1").arg("tests/peers/parquet_rates.py").arg(file);
    answer(&mut command)
}

fn compare(rounds: &[Round]) -> Vec<Measurement> {
    let raw = megabytes(rounds[0].ours.raw_bytes);
    let ours = |seconds: fn(&Ours) -> f64| {
        median(rounds.iter().map(|round| raw / seconds(&round.ours)).collect())
    };
    let theirs = |version: fn(&Theirs) -> String, seconds: fn(&Theirs) -> f64| {
        let rates: Option<Vec<f64>> = rounds
            .iter()
            .map(|round| round.theirs.as_ref().map(|theirs| raw / seconds(theirs)))
            .collect();
        let version = version(rounds[0].theirs.as_ref()?);
        rates.map(|rates| Peer { value: median(rates), version })
    };
    let pyarrow = |theirs: &Theirs| format!("pyarrow {}", theirs.pyarrow);
    let polars = |theirs: &Theirs| format!("polars {}", theirs.polars);
    let write = ours(|ours| ours.write_s);
    let read = ours(|ours| ours.read_s);
    let pair = |name: &str, ours: f64, peer: Option<Peer>| {
        Measurement::compared(name, ours, peer, "MB/s", None)
    };
    let mut measurements = vec![
        pair("write", write, theirs(pyarrow, |theirs| theirs.pyarrow_write_s)),
        pair("read own file", read, theirs(pyarrow, |theirs| theirs.pyarrow_read_s)),
    ];
    if rounds[0].theirs.is_some() {
        let name = "read our file";
        let by_pyarrow = theirs(pyarrow, |theirs| theirs.pyarrow_read_ours_s);
        measurements.push(pair(name, read, by_pyarrow));
        measurements.push(pair(name, read, theirs(polars, |theirs| theirs.polars_read_ours_s)));
    }
    let size = |bytes: u64| megabytes(bytes) / raw * 100.0;
    let peer = rounds[0].theirs.as_ref();
    let peer = peer.map(|theirs| Peer { value: size(theirs.file_bytes), version: pyarrow(theirs) });
    let file = size(rounds[0].ours.file_bytes);
    measurements.push(Measurement::compared("size of the file", file, peer, "% raw", None));
    measurements.push(Measurement::alone("raw", raw, "MB", None));
    measurements
}

#[expect(clippy::cast_precision_loss, reason = "a table shows three digits")]
fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ours(write_s: f64) -> Ours {
        Ours { raw_bytes: 256_000_000, file_bytes: 192_000_000, write_s, read_s: 0.1 }
    }

    fn theirs() -> Theirs {
        Theirs {
            pyarrow: "26".to_owned(),
            polars: "2".to_owned(),
            file_bytes: 128_000_000,
            pyarrow_write_s: 1.0,
            pyarrow_read_s: 0.4,
            pyarrow_read_ours_s: 0.2,
            polars_read_ours_s: 0.8,
        }
    }

    #[test]
    fn rates_are_of_plain_columns_and_medians_of_rounds() {
        let rounds =
            [2.0, 0.5, 0.25].map(|write_s| Round { ours: ours(write_s), theirs: Some(theirs()) });
        let measurements = compare(&rounds);
        let numbers: Vec<(f64, Option<f64>, &str)> = measurements
            .iter()
            .map(|measurement| {
                (
                    measurement.ours,
                    measurement.peer,
                    measurement.peer_version.as_deref().unwrap_or(""),
                )
            })
            .collect();
        let expected = [
            (512.0, Some(256.0), "pyarrow 26"),
            (2560.0, Some(640.0), "pyarrow 26"),
            (2560.0, Some(1280.0), "pyarrow 26"),
            (2560.0, Some(320.0), "polars 2"),
            (75.0, Some(50.0), "pyarrow 26"),
            (256.0, None, ""),
        ];
        assert_eq!(numbers, expected);
    }

    #[test]
    fn without_peers_there_are_our_rates_alone() {
        let measurements = compare(&[Round { ours: ours(1.0), theirs: None }]);
        assert_eq!(measurements.len(), 4);
        assert!(measurements.iter().all(|measurement| measurement.peer.is_none()));
    }
}
