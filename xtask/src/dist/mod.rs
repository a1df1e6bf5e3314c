//! `cargo xtask dist`: packages for machines without a compiler.
//!
//! Every package contains the program that tests and benchmarks run. Nothing is compiled a second
//! time.

mod deb;
mod documents;
mod notices;
mod wheel;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use anyhow::Context;
use clap::Args;

use crate::places::repository;
use crate::product;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Make the wheel for pip, and the others only if they are named, too
    #[arg(long)]
    wheel: bool,

    /// Make the package for Debian, and the others only if they are named, too
    #[arg(long)]
    deb: bool,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let torqued = product::build()?;
    documents::write(&torqued, &documents_folder())?;
    let all = !arguments.wheel && !arguments.deb;
    let folder = repository().join("dist");
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    if all || arguments.wheel {
        remove(&folder, "whl")?;
        wheel::build(&folder)?;
    }
    if all || arguments.deb {
        remove(&folder, "deb")?;
        deb::build(&folder)?;
    }
    for package in packages(&folder)? {
        let bytes = fs::metadata(&package)?.len();
        println!("{} ({:.1} MB)", package.display(), bytes as f64 / 1e6);
    }
    if all {
        // The user builds the image from the Debian package, or from source, with an engine of
        // their own.
        println!("{}", repository().join("deploy/container/Containerfile").display());
    }
    Ok(ExitCode::SUCCESS)
}

/// The folder in which maturin looks for the additional files of a wheel, and `Cargo.toml` for
/// those of the Debian package.
fn documents_folder() -> PathBuf {
    repository().join("torqued.data/data/share")
}

/// Deletes packages of earlier versions, which would stay beside the new one.
fn remove(folder: &Path, extension: &str) -> anyhow::Result<()> {
    for package in packages(folder)? {
        if package.extension().is_some_and(|found| found == extension) {
            fs::remove_file(&package)
                .with_context(|| format!("cannot delete {}", package.display()))?;
        }
    }
    Ok(())
}

/// The packages of a folder in alphabetical order.
fn packages(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut packages = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "whl" || extension == "deb") {
            packages.push(path);
        }
    }
    packages.sort();
    Ok(packages)
}

/// Sets the commit's time as the time of all files, so that the same commit makes the same bytes.
fn dated(command: &mut Command) -> &mut Command {
    const VARIABLE: &str = "SOURCE_DATE_EPOCH";
    if std::env::var_os(VARIABLE).is_none() {
        let commit = Command::new("git")
            .args(["log", "-1", "--format=%ct"])
            .current_dir(repository())
            .output();
        let moment = commit.ok().filter(|output| output.status.success());
        // Without a repository, files have the time of the build.
        if let Some(moment) = moment.and_then(|output| String::from_utf8(output.stdout).ok()) {
            command.env(VARIABLE, moment.trim());
        }
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_of_one_kind_are_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.whl", "b.deb", "notes.txt"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        remove(folder.path(), "whl").unwrap();
        assert_eq!(packages(folder.path()).unwrap(), [folder.path().join("b.deb")]);
        assert!(folder.path().join("notes.txt").exists());
    }
}
