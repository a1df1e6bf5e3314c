//! The first build: processor time of the program and of each crate, in a folder of its own.
//!
//! Time on the clock depends on what else runs. Processor time depends on it less, so it decides
//! whether a change of the manifests is worth it. This program stands between cargo and rustc
//! (`RUSTC_WRAPPER`) and notes the time of each call.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

use anyhow::{Context, ensure};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;

use super::measurement::{Goal, Measurement};
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::places::target;
use crate::process::{self, command};

/// The whole build on two cores, in seconds.
const GOAL: Goal = Goal::AtMost(720.0);

/// Crates in the table, those that take longest.
const LONGEST: usize = 25;

/// The variable with the file for the times of the calls of rustc.
const TIMES: &str = "TORQUED_RUSTC_TIMES";

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    if wanted.peers == Peers::Measured {
        eprintln!("no other program is this one: nothing to compare with");
    }
    let folder = target().join("first-build");
    if folder.exists() {
        fs::remove_dir_all(&folder)
            .with_context(|| format!("cannot empty {}", folder.display()))?;
    }
    fs::create_dir_all(&folder)?;
    let times = folder.join("rustc-times.txt");
    File::create(&times)?;
    let before = processor_seconds()?;
    let started = Instant::now();
    let mut build = command("cargo", &["build", "--release", "--bin", "torqued"]);
    build.env("CARGO_TARGET_DIR", &folder).env(TIMES, &times);
    build.env("RUSTC_WRAPPER", std::env::current_exe()?);
    let finished = process::run(&mut build)?;
    ensure!(finished.success, "torqued does not build");
    let seconds = started.elapsed().as_secs_f64();
    let mut measurements = vec![
        Measurement::alone("first build", seconds, "s", Some(GOAL)),
        Measurement::alone("its processor time", processor_seconds()? - before, "s", None),
    ];
    let units = units(&fs::read_to_string(&times)?);
    measurements.extend(
        units
            .into_iter()
            .take(LONGEST)
            .map(|(name, seconds)| Measurement::alone(name, seconds, "s", None)),
    );
    Ok(BenchmarkResults { notes: Vec::new(), measurements })
}

/// Processor time of all children that have ended, and of their children, s.
fn processor_seconds() -> anyhow::Result<f64> {
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN)?;
    let microseconds =
        usage.user_time().num_microseconds() + usage.system_time().num_microseconds();
    Ok(microseconds as f64 / 1e6)
}

/// Reads lines `SECONDS NAME` and puts the longest first.
fn units(text: &str) -> Vec<(String, f64)> {
    let mut units: Vec<(String, f64)> = text
        .lines()
        .filter_map(|line| line.split_once(' '))
        .filter_map(|(seconds, name)| Some((name.to_owned(), seconds.parse().ok()?)))
        .collect();
    units.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    units
}

/// Calls rustc in place of cargo, if this program was started for that.
///
/// # Errors
/// When rustc cannot be started, or its time cannot be noted.
pub fn instead_of_rustc() -> anyhow::Result<Option<ExitCode>> {
    let Some(times) = std::env::var_os(TIMES) else { return Ok(None) };
    let words: Vec<OsString> = std::env::args_os().skip(1).collect();
    let [program, arguments @ ..] = &words[..] else { return Ok(None) };
    let status = Command::new(program).args(arguments).status().context("cannot run rustc")?;
    let name = arguments.iter().skip_while(|word| *word != "--crate-name").nth(1);
    if let Some(name) = name {
        note(Path::new(&times), &name.to_string_lossy())?;
    }
    Ok(Some(if status.success() { ExitCode::SUCCESS } else { ExitCode::FAILURE }))
}

/// Adds a line. Lines of calls that run at the same time do not mix.
fn note(times: &Path, name: &str) -> anyhow::Result<()> {
    let line = format!("{:.2} {name}\n", processor_seconds()?);
    OpenOptions::new().append(true).open(times)?.write_all(line.as_bytes())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crates_that_take_longest_come_first() {
        let found = units("0.50 serde\n61.20 burn_flex\nnonsense\n7.00 api\n");
        let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["burn_flex", "api", "serde"]);
    }

    #[test]
    fn a_program_without_the_variable_is_not_rustc() {
        assert!(instead_of_rustc().unwrap().is_none());
    }
}
