use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, ensure};

/// A server on a free port. Dropping it kills the server.
pub(super) struct Serving {
    process: Child,
    pub url: String,
}

impl Serving {
    pub fn start(torqued: &Path, data: &Path, workers: usize) -> anyhow::Result<Self> {
        let mut process = Command::new(torqued)
            .args(["serve", "--workers", &workers.to_string()])
            .args(["--listen", "127.0.0.1:0", "--data"])
            .arg(data)
            .stdout(Stdio::piped())
            .spawn()
            .context("cannot run torqued serve")?;
        let mut line = String::new();
        if let Some(stdout) = process.stdout.take() {
            BufReader::new(stdout).read_line(&mut line)?;
        }
        let url = line.split_whitespace().last().unwrap_or_default().to_owned();
        let serving = Self { process, url };
        ensure!(serving.url.starts_with("http://"), "torqued serve did not say where: {line:?}");
        Ok(serving)
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        // Its work is committed or will be done again, and its workers end with it.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
