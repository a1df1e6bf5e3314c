//! The program, built and run as a user runs it.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};

use crate::process::{self, command};
use crate::{repository, target};

/// Builds the program in the profile it is shipped in.
pub fn build() -> anyhow::Result<PathBuf> {
    let built = process::run(&mut command("cargo", &["build", "--release", "--bin", "torqued"]))?;
    ensure!(built.success, "torqued does not build");
    Ok(target().join("release/torqued"))
}

/// Builds an example of a crate of ours.
pub fn build_example(package: &str, example: &str) -> anyhow::Result<PathBuf> {
    let arguments = ["build", "--release", "--package", package, "--example", example];
    let built = process::run(&mut command("cargo", &arguments))?;
    ensure!(built.success, "example {example} of {package} does not build");
    Ok(target().join("release/examples").join(example))
}

/// What a simulation without a server took.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    pub seconds: f64,
    /// The most memory that was resident at once, GiB.
    pub peak_gib: f64,
}

/// Simulates `spec` into `folder`, which is emptied before.
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
    let started = Instant::now();
    let mut child = Command::new(torqued)
        .arg("simulate")
        .arg("--spec")
        .arg(spec)
        .arg("--out")
        .arg(folder)
        .current_dir(repository())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .context("cannot run torqued")?;
    let mut peak_gib: f64 = 0.0;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        peak_gib = peak_gib.max(peak_memory_gib(child.id()).unwrap_or_default());
        thread::sleep(Duration::from_millis(10));
    };
    let seconds = started.elapsed().as_secs_f64();
    ensure!(status.success(), "torqued simulate --spec {} failed", spec.display());
    Ok(Cost { seconds, peak_gib })
}

/// The high-water mark of a process's resident memory, while it lives.
fn peak_memory_gib(process: u32) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    crate::machine::gibibytes(crate::machine::field(&status, "VmHWM")?)
}

/// Bytes of all files of a folder that lie directly in it.
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
    fn the_bytes_of_a_folder_are_those_of_its_files() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a"), [0; 300]).unwrap();
        fs::write(folder.path().join("b"), [0; 45]).unwrap();
        assert_eq!(folder_bytes(folder.path()).unwrap(), 345);
    }
}
