//! The PostgreSQL of a benchmark. A program of `store` starts and ends it.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

use anyhow::Context;
use serde::Deserialize;

use super::program::Program;

/// A cluster that ends when it is dropped.
pub struct Cluster {
    child: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
    /// Its first process. The processes of connections are its children.
    pub server: u32,
}

#[derive(Deserialize)]
struct Created {
    url: String,
    server: u32,
}

impl Cluster {
    pub fn start(program: &Program) -> anyhow::Result<Self> {
        let mut child = program
            .alone("cluster")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("cannot start a cluster")?;
        let input = child.stdin.take();
        let output = BufReader::new(child.stdout.take().context("a cluster without output")?);
        let mut cluster = Self { child, input, output, server: 0 };
        cluster.server = cluster.create("first")?.server;
        Ok(cluster)
    }

    /// Creates an empty database, and returns its URL.
    pub fn database(&mut self, name: &str) -> anyhow::Result<String> {
        Ok(self.create(name)?.url)
    }

    fn create(&mut self, name: &str) -> anyhow::Result<Created> {
        let input = self.input.as_mut().context("the cluster was ended")?;
        writeln!(input, "{name}").context("the cluster ended")?;
        let mut line = String::new();
        self.output.read_line(&mut line)?;
        serde_json::from_str(&line).with_context(|| format!("the cluster said {line:?}"))
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.input = None;
        let _ = self.child.wait();
    }
}
