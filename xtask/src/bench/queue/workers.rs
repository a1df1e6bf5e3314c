//! Processes of workers, controlled by lines on their standard input.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

use anyhow::{Context, ensure};
use serde::Deserialize;

use super::program::{Program, QueueLocation};

const PROCESSES: u32 = 4;

/// Processes that are killed if they are dropped before their end.
pub struct Workers(Vec<Process>);

struct Process {
    child: Child,
    /// Closing it ends the process.
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

/// The report of a process at its end.
#[derive(Deserialize)]
struct ProcessReport {
    waits_us: Vec<f64>,
}

impl Workers {
    /// Starts the processes and returns when all are connected.
    pub fn start(program: &Program, place: &QueueLocation, workers: u32) -> anyhow::Result<Self> {
        let mut started = Self(Vec::new());
        for share in shares(workers) {
            let command = &mut program.command("work", place, &[&share.to_string()]);
            let mut child = command
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()
                .context("cannot start workers")?;
            let input = child.stdin.take();
            let output = BufReader::new(child.stdout.take().context("workers without output")?);
            started.0.push(Process { child, input, output });
        }
        for process in &mut started.0 {
            let line = process.read()?;
            ensure!(line == "ready", "workers said {line:?}");
        }
        Ok(started)
    }

    /// Lets them begin.
    pub fn go(&mut self) -> anyhow::Result<()> {
        self.0.iter_mut().try_for_each(|process| process.write("go"))
    }

    /// Number of tasks that they have completed.
    pub fn count(&mut self) -> anyhow::Result<u64> {
        for process in &mut self.0 {
            process.write("count")?;
        }
        let mut completed = 0;
        for process in &mut self.0 {
            let line = process.read()?;
            completed += line.parse::<u64>().with_context(|| format!("workers said {line:?}"))?;
        }
        Ok(completed)
    }

    pub fn processes(&self) -> Vec<u32> {
        self.0.iter().map(|process| process.child.id()).collect()
    }

    /// Ends them and gives the time that each task had waited, in milliseconds: a list for each
    /// process, in the order in which it began the tasks.
    pub fn end(mut self) -> anyhow::Result<Vec<Vec<f64>>> {
        let mut waits_ms = Vec::new();
        for process in &mut self.0 {
            process.input = None;
            let report: ProcessReport = serde_json::from_str(&process.read()?)?;
            waits_ms.push(report.waits_us.into_iter().map(|us| us / 1e3).collect());
            process.child.wait()?;
        }
        Ok(waits_ms)
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        for process in &mut self.0 {
            // Most have ended already.
            let _ = process.child.kill();
            let _ = process.child.wait();
        }
    }
}

impl Process {
    fn write(&mut self, line: &str) -> anyhow::Result<()> {
        let input = self.input.as_mut().context("workers were ended")?;
        writeln!(input, "{line}").context("workers ended")
    }

    fn read(&mut self) -> anyhow::Result<String> {
        let mut line = String::new();
        self.output.read_line(&mut line)?;
        ensure!(!line.is_empty(), "workers ended");
        Ok(line.trim_end().to_owned())
    }
}

/// The number of workers in each process.
fn shares(workers: u32) -> Vec<u32> {
    let processes = PROCESSES.min(workers);
    let share = |process| workers / processes + u32::from(process < workers % processes);
    (0..processes).map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workers_are_spread_over_at_most_four_processes() {
        assert_eq!(shares(1), [1]);
        assert_eq!(shares(6), [2, 2, 1, 1]);
        assert_eq!(shares(64), [16; 4]);
    }
}
