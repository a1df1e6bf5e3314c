//! Writes objects to a store and reads them: a folder, and a bucket whose server runs on the same
//! machine.

use serde::Deserialize;

use super::measurement::Measurement;
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::places::target;
use crate::product;

/// The size of the shards of a million trajectories.
const MEGABYTES: u32 = 128;
const OBJECTS: u32 = 8;

/// Megabytes (2^20 bytes) per second.
#[derive(Deserialize)]
struct Rates {
    write: f64,
    download: f64,
    read: f64,
    read_again: f64,
}

#[derive(Deserialize)]
struct Places {
    folder: Rates,
    bucket: Rates,
}

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    if wanted.peers == Peers::Measured {
        eprintln!("a folder is what a bucket is compared with");
    }
    let program = product::build_example("object_rates")?;
    let folder = tempfile::Builder::new().prefix("bench-objects-").tempdir_in(target())?;
    let mut command = std::process::Command::new(program);
    command.arg(folder.path()).args([OBJECTS, MEGABYTES].map(|number| number.to_string()));
    let places: Places = super::dynamics::answer(&mut command)?;
    let named = [("folder", places.folder), ("bucket", places.bucket)];
    let rows = |(place, rates): (&str, Rates)| {
        [
            ("written and published", rates.write),
            ("downloaded", rates.download),
            ("read for the first time, SHA-256 compared", rates.read),
            ("read again", rates.read_again),
        ]
        .map(|(what, rate)| Measurement::alone(format!("{place}, {what}"), rate, "MB/s", None))
    };
    Ok(BenchmarkResults {
        notes: vec![
            format!(
                "{OBJECTS} objects of {MEGABYTES} MB one after the other, each synced to the disk"
            ),
            "the bucket's server (s3s-fs) shares processors and disk, and compares each SHA-256"
                .to_owned(),
        ],
        measurements: named.into_iter().flat_map(rows).collect(),
    })
}
