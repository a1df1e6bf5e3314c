//! Builds the program and runs it like a user.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};

use crate::places::{repository, target};
use crate::process::{self, command};

/// Builds the program in its release profile.
pub fn build() -> anyhow::Result<PathBuf> {
    let built = process::run(&mut command("cargo", &["build", "--release", "--bin", "torqued"]))?;
    ensure!(built.success, "torqued does not build");
    Ok(target().join("release/torqued"))
}

/// Builds an example of one of our crates, with the dependencies of the tests.
pub fn build_example(example: &str) -> anyhow::Result<PathBuf> {
    let arguments = ["build", "--release", "--workspace", "--example", example];
    let built = process::run(&mut command("cargo", &arguments))?;
    ensure!(built.success, "example {example} does not build");
    Ok(target().join("release/examples").join(example))
}

/// The cost of a simulation without a server.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    pub seconds: f64,
    /// Processor time of all threads on all cores, s. A single core without other load would take
    /// this long.
    pub processor_seconds: f64,
    /// The largest resident memory, GiB.
    pub peak_gib: f64,
}

/// Simulates `spec` into `folder`, which is emptied first.
pub fn simulate_anew(torqued: &Path, spec: &Path, folder: &Path) -> anyhow::Result<Cost> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            return Err(error).with_context(|| format!("cannot empty {}", folder.display()));
        }
        _ => {}
    }
    if let Some(parent) = folder.parent() {
        fs::create_dir_all(parent)?;
    }
    let mut simulate = Command::new(torqued);
    simulate.arg("simulate").arg("--spec").arg(spec).arg("--out").arg(folder);
    cost_of(simulate.current_dir(repository()))
}

/// Runs a command to its end, without its output.
pub fn cost_of(command: &mut Command) -> anyhow::Result<Cost> {
    let program = command.get_program().to_string_lossy().into_owned();
    let started = Instant::now();
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .with_context(|| format!("cannot run {program}"))?;
    let mut peak_gib: f64 = 0.0;
    let mut processor_seconds: f64 = 0.0;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        peak_gib = peak_gib.max(peak_memory_gib(child.id()).unwrap_or_default());
        processor_seconds = processor_seconds.max(processor_time_s(child.id()).unwrap_or_default());
        thread::sleep(Duration::from_millis(10));
    };
    let seconds = started.elapsed().as_secs_f64();
    ensure!(status.success(), "{program} failed");
    Ok(Cost { seconds, processor_seconds, peak_gib })
}

/// The largest resident memory of a running process so far.
fn peak_memory_gib(process: u32) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    crate::machine::gibibytes(crate::machine::field(&status, "VmHWM")?)
}

/// The processor time of a running process so far, in user and kernel mode.
fn processor_time_s(process: u32) -> Option<f64> {
    /// Ticks of the kernel's clock in this file, on all common architectures of Linux.
    const TICKS_PER_S: f64 = 100.0;
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    Some(ticks(&stat)? / TICKS_PER_S)
}

/// Fields 14 and 15 of `/proc/PID/stat`. The second field is a name that may contain anything.
fn ticks(stat: &str) -> Option<f64> {
    let (_, after_name) = stat.rsplit_once(')')?;
    let mut fields = after_name.split_whitespace().skip(11);
    let mut next = || fields.next()?.parse::<f64>().ok();
    Some(next()? + next()?)
}

/// Bytes of all files directly in a folder.
pub fn folder_bytes(folder: &Path) -> anyhow::Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder)? {
        bytes += entry?.metadata()?.len();
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_a_living_process_is_known_and_of_a_dead_one_is_not() {
        let ours = peak_memory_gib(std::process::id()).unwrap();
        assert!((0.0001..100.0).contains(&ours), "{ours} GiB");
        assert_eq!(peak_memory_gib(u32::MAX), None);
    }

    #[test]
    fn processor_time_is_that_of_user_and_kernel_whatever_the_name() {
        let stat = "71 (a) b (c) S 1 71 71 0 -1 4194560 9 9 0 0 150 25 7 7 20 0 3 0 100 1000 9";
        assert_eq!(ticks(stat), Some(175.0));
        assert_eq!(ticks("71 (cut off) S 1 71"), None);
        assert!(processor_time_s(std::process::id()).is_some());
    }

    #[test]
    fn the_bytes_of_a_folder_are_those_of_its_files() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a"), [0; 300]).unwrap();
        fs::write(folder.path().join("b"), [0; 45]).unwrap();
        assert_eq!(folder_bytes(folder.path()).unwrap(), 345);
    }
}
