//! A million trajectories, simulated and written by the command that needs no server.

use std::path::Path;

use super::measurement::{Goal, Measurement};
use super::{dynamics, isa};
use crate::places::target;
use crate::product;

pub(super) const TRAJECTORIES: u64 = 1_000_000;
/// A smaller number, simulated first, to see whether memory grows with the number.
const FEWER: u64 = 100_000;

/// Bounds in seconds, with AVX-512 and without.
const SECONDS: (f64, f64) = (100.0, 150.0);
const PEAK_GIB: Goal = Goal::AtMost(1.0);
/// The bound on the ratio of both peaks of memory. Memory is constant except for chance.
const GROWTH: Goal = Goal::AtMost(1.1);

/// Measures the million. It needs 17 GB of disk, which are free again afterwards.
pub(super) fn run(torqued: &Path) -> anyhow::Result<Vec<Measurement>> {
    std::fs::create_dir_all(target())?;
    // The files go to the build's disk, because the one for temporary files is often smaller.
    let folder = tempfile::Builder::new().prefix("bench-million-").tempdir_in(target())?;
    let (fewer, _) = simulate(torqued, folder.path(), FEWER)?;
    let (all, bytes) = simulate(torqued, folder.path(), TRAJECTORIES)?;
    let seconds = Goal::AtMost(isa::bound(SECONDS.0, SECONDS.1));
    Ok(vec![
        Measurement::alone("10^6 trajectories written", all.seconds, "s", Some(seconds)),
        Measurement::alone("their processor time", all.processor_seconds, "s", None),
        Measurement::alone("their files", gigabytes(bytes), "GB", None),
        Measurement::alone("rate of writing", gigabytes(bytes) * 1e3 / all.seconds, "MB/s", None),
        Measurement::alone("peak memory", all.peak_gib, "GiB", Some(PEAK_GIB)),
        Measurement::alone("peak memory for 10^5", fewer.peak_gib, "GiB", None),
        Measurement::alone("growth of memory", all.peak_gib / fewer.peak_gib, "", Some(GROWTH)),
    ])
}

/// Simulates, and deletes the files.
fn simulate(
    torqued: &Path,
    folder: &Path,
    trajectories: u64,
) -> anyhow::Result<(product::Cost, u64)> {
    eprintln!("{trajectories} trajectories");
    let spec = folder.join("spec.json");
    std::fs::write(&spec, dynamics::spec(trajectories).to_string())?;
    let dataset = folder.join("dataset");
    let cost = product::simulate_anew(torqued, &spec, &dataset)?;
    let bytes = product::folder_bytes(&dataset)?;
    std::fs::remove_dir_all(&dataset)?;
    Ok((cost, bytes))
}

#[expect(clippy::cast_precision_loss, reason = "a table shows three digits")]
fn gigabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e9
}
