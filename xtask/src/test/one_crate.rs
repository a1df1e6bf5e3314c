//! Tests of one crate, from the build that all crates share.
//!
//! Cargo enables only those features of dependencies that the chosen crates ask for. `-p models`
//! alone would build burn again with fewer features. So the program is chosen as well, whose
//! manifest asks for all of them, and the targets are named so that none of the program is built.

use std::process::{Command, ExitCode, Stdio};

use anyhow::{Context, ensure};
use serde::Deserialize;

use crate::process::{self, command};

/// The program, which asks for the features that all crates need.
const PROGRAM: &str = "torqued";

#[derive(Deserialize)]
struct Workspace {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    targets: Vec<Target>,
}

#[derive(Deserialize)]
struct Target {
    name: String,
    kind: Vec<String>,
    /// Features of devices. Their tests belong to `cargo xtask test --devices`.
    #[serde(default, rename = "required-features")]
    required_features: Vec<String>,
}

/// Runs the tests of `name`. The runner gets `further` arguments.
pub fn run(name: &str, further: &[String]) -> anyhow::Result<ExitCode> {
    let workspace = workspace()?;
    let package = workspace.packages.iter().find(|package| package.name == name);
    let names = || workspace.packages.iter().map(|package| package.name.as_str());
    let package = package.with_context(|| {
        format!("there is no crate {name:?}, only {}", names().collect::<Vec<_>>().join(", "))
    })?;
    let status = tests(package).args(further).stdin(Stdio::null()).status();
    let status = status.context("cannot run cargo")?;
    Ok(if status.success() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn workspace() -> anyhow::Result<Workspace> {
    let mut metadata = command("cargo", &["metadata", "--no-deps", "--format-version", "1"]);
    let output = metadata.output().context("cannot run cargo")?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).context("cannot read cargo's metadata")
}

/// The command that tests a crate, with nextest if it is installed.
fn tests(package: &Package) -> Command {
    let nextest = ["nextest", "run", "--cargo-profile", "release"];
    let runner: &[&str] =
        if process::exists("cargo-nextest") { &nextest } else { &["test", "--release"] };
    let mut command = command("cargo", runner);
    command.args(["--package", &package.name, "--package", PROGRAM]);
    command.args(targets(package));
    command
}

/// The flags that choose a crate's targets with tests.
fn targets(package: &Package) -> Vec<String> {
    let is_built = |target: &&Target| target.required_features.is_empty();
    let flags = package.targets.iter().filter(is_built).filter_map(|target| {
        match target.kind.first()?.as_str() {
            "lib" => Some(vec!["--lib".to_owned()]),
            kind @ ("bin" | "test") => Some(vec![format!("--{kind}"), target.name.clone()]),
            _ => None,
        }
    });
    flags.flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tests_of_a_crate_are_named_without_those_of_the_program() {
        let target = |name: &str, kind: &str, required: &[&str]| Target {
            name: name.to_owned(),
            kind: vec![kind.to_owned()],
            required_features: required.iter().map(ToString::to_string).collect(),
        };
        let package = Package {
            name: "models".into(),
            targets: vec![
                target("models", "lib", &[]),
                target("rates", "example", &[]),
                target("leaks", "test", &[]),
                target("devices", "test", &["gpu"]),
            ],
        };
        assert_eq!(targets(&package), ["--lib", "--test", "leaks"]);
    }

    #[test]
    fn an_unknown_crate_is_answered_with_all_names() {
        let error = run("modles", &[]).unwrap_err().to_string();
        assert!(error.contains("\"modles\"") && error.contains("models, "), "{error}");
    }
}
