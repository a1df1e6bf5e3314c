//! A job's progress on stderr until it ends: bars on a terminal, else plain lines.

mod bars;
mod lines;
pub mod measure;
mod own_work;
mod rate;

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use wire::{Job, JobState, Progress};

use crate::client::{Client, ClientError};
use bars::Bars;
use lines::Lines;
pub use own_work::{Report, follow_own};
use rate::Rate;

/// How often the server is asked.
const POLL_EVERY: Duration = Duration::from_millis(400);

/// How long a server that does not answer is waited for: it may be restarting.
const PATIENCE: Duration = Duration::from_secs(30);

/// Shows a job until it ends, and returns it.
///
/// # Errors
/// When the server refuses, or does not answer for 30 s.
pub async fn follow(client: &Client, id: i64) -> Result<Job, ClientError> {
    let mut display = Display::new();
    let mut rates: Vec<Rate> = Vec::new();
    let mut last_answer = Instant::now();
    loop {
        let job = match client.job(id).await {
            Ok(job) => job,
            Err(ClientError::Unreachable { .. }) if last_answer.elapsed() < PATIENCE => {
                tokio::time::sleep(POLL_EVERY).await;
                continue;
            }
            Err(error) => return Err(error),
        };
        last_answer = Instant::now();
        let mut rows = rows(&job);
        rates.resize_with(rows.len(), Rate::default);
        for (row, rate) in rows.iter_mut().zip(&mut rates) {
            let observed = rate.observe(row.progress.done, last_answer);
            row.rate_per_second = row.progress.rate_per_second.or(observed);
        }
        display.show(&rows);
        if job.state.is_final() {
            display.finish();
            return Ok(job);
        }
        tokio::time::sleep(POLL_EVERY).await;
    }
}

/// One line of the display: a job, or one member of a pipeline.
#[derive(Clone, Debug)]
struct Row {
    name: String,
    state: JobState,
    reused: bool,
    error: Option<String>,
    progress: Progress,
    /// In units of `progress`.
    rate_per_second: Option<f64>,
}

fn rows(job: &Job) -> Vec<Row> {
    if job.members.is_empty() {
        return vec![Row {
            name: job.kind.to_string(),
            state: job.state,
            reused: false,
            error: job.error.clone(),
            progress: job.progress.clone(),
            rate_per_second: None,
        }];
    }
    job.members
        .iter()
        .map(|member| Row {
            name: member.name.clone(),
            state: member.state,
            reused: member.reused,
            error: member.error.clone(),
            progress: member.progress.clone(),
            rate_per_second: None,
        })
        .collect()
}

impl Row {
    /// What is known beside the name: state, amount, rate, time left.
    fn describe(&self) -> String {
        if self.reused && self.state == JobState::Succeeded {
            return "reused, computed before".to_owned();
        }
        if self.state.is_final()
            && let Some(error) = &self.error
        {
            return format!("{}: {error}", self.state);
        }
        match self.state {
            JobState::Waiting | JobState::Queued | JobState::Cancelled | JobState::Failed => {
                self.state.to_string()
            }
            JobState::Succeeded => format!("done, {}", self.amount()),
            JobState::Running => {
                let mut parts = vec![self.amount()];
                if let Some(rate) = self.rate_per_second.filter(|rate| *rate > 0.0) {
                    parts.push(format!("{}/s", measure::rounded(rate)));
                    let left = self.progress.total.saturating_sub(self.progress.done) as f64 / rate;
                    if let Ok(left) = Duration::try_from_secs_f64(left) {
                        parts.push(format!("ETA {}", measure::duration(left)));
                    }
                }
                parts.extend(self.progress.message.clone());
                parts.join(", ")
            }
        }
    }

    /// For example "8 192 of 16 384 trajectories".
    fn amount(&self) -> String {
        let Progress { done, total, unit, .. } = &self.progress;
        let done_of_total = if self.state == JobState::Succeeded || *total == 0 {
            measure::count(*done)
        } else {
            format!("{} of {}", measure::count(*done), measure::count(*total))
        };
        format!("{done_of_total} {unit}").trim_end().to_owned()
    }

    /// Share done, 0 to 1.
    fn fraction(&self) -> f64 {
        let Progress { done, total, .. } = self.progress;
        if self.state == JobState::Succeeded {
            1.0
        } else if total > 0 {
            (done as f64 / total as f64).min(1.0)
        } else {
            0.0
        }
    }
}

enum Display {
    Bars(Bars),
    Lines(Lines),
}

impl Display {
    fn new() -> Self {
        if std::io::stderr().is_terminal() {
            Self::Bars(Bars::new())
        } else {
            Self::Lines(Lines::default())
        }
    }

    fn show(&mut self, rows: &[Row]) {
        match self {
            Self::Bars(bars) => bars.show(rows),
            Self::Lines(lines) => {
                for line in lines.changes(rows, Instant::now()) {
                    eprintln!("{line}");
                }
            }
        }
    }

    fn finish(self) {
        if let Self::Bars(bars) = self {
            bars.finish();
        }
    }
}

#[cfg(test)]
fn row(name: &str, state: JobState, done: u64) -> Row {
    let progress = Progress { done, total: 2000, unit: "steps".to_owned(), ..Progress::default() };
    Row {
        name: name.to_owned(),
        state,
        reused: false,
        error: None,
        progress,
        rate_per_second: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_running_job_shows_amount_rate_and_time_left() {
        let mut running = row("train", JobState::Running, 500);
        running.rate_per_second = Some(12.5);
        assert_eq!(running.describe(), "500 of 2 000 steps, 12.5/s, ETA 2m 00s");
    }

    #[test]
    fn a_failed_job_shows_its_reason() {
        let mut failed = row("train", JobState::Failed, 500);
        failed.error = Some("loss is not finite".to_owned());
        assert_eq!(failed.describe(), "failed: loss is not finite");
    }
}
