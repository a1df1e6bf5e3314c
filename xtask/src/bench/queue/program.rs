//! Programs with the arguments of `store/examples/queue_rates`.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};

use crate::places::repository;

/// The argument of such a program in place of a URL.
pub const SQLITE: &str = "sqlite";

pub struct Program {
    path: PathBuf,
    /// Arguments before all others.
    leading: Vec<String>,
}

/// The place of a queue.
pub struct QueueLocation {
    pub folder: PathBuf,
    /// [`SQLITE`], or a URL of PostgreSQL.
    pub database: String,
}

impl Program {
    pub fn new(path: PathBuf, leading: impl IntoIterator<Item = String>) -> Self {
        Self { path, leading: leading.into_iter().collect() }
    }

    /// A command that is not started yet, with empty standard input.
    pub fn alone(&self, role: &str) -> Command {
        let mut command = Command::new(&self.path);
        command.args(&self.leading).arg(role).current_dir(repository()).stdin(Stdio::null());
        command
    }

    pub fn command(&self, role: &str, place: &QueueLocation, rest: &[&str]) -> Command {
        let mut command = self.alone(role);
        command.arg(&place.folder).arg(&place.database).args(rest);
        command
    }

    /// Runs the program to its end and gives its output. It must succeed.
    pub fn run(&self, role: &str, place: &QueueLocation, rest: &[&str]) -> anyhow::Result<String> {
        let program = self.path.display();
        let output = self
            .command(role, place, rest)
            .output()
            .with_context(|| format!("cannot run {program}"))?;
        let error = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "{program} {role}: {error}");
        Ok(String::from_utf8(output.stdout)?)
    }
}
