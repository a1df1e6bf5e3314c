use std::time::Duration;

use wire::{JobState, Progress};

use super::measure;

/// One line of the display: a job, or one member of a pipeline.
#[derive(Clone, Debug)]
pub struct Row {
    pub name: String,
    pub state: JobState,
    pub reused: bool,
    pub error: Option<String>,
    /// Why queued tasks wait, besides waiting for their turn.
    pub waits_for: Option<String>,
    pub progress: Progress,
    /// In units of `progress` per second.
    pub rate_per_second: Option<f64>,
}

impl Row {
    /// The description beside the name: state, amount, rate, time left.
    pub fn describe(&self) -> String {
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
                let waits_for = self.waits_for.iter().map(|reason| format!(", {reason}"));
                self.state.to_string() + &waits_for.collect::<String>()
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
                parts.extend(self.waits_for.clone());
                parts.join(", ")
            }
        }
    }

    /// For example "8 192 of 16 384 trajectories".
    pub fn amount(&self) -> String {
        let Progress { done, total, unit, .. } = &self.progress;
        let done_of_total = if self.state == JobState::Succeeded || *total == 0 {
            measure::count(*done)
        } else {
            format!("{} of {}", measure::count(*done), measure::count(*total))
        };
        format!("{done_of_total} {unit}").trim_end().to_owned()
    }

    /// Share done, 0 to 1.
    pub fn fraction(&self) -> f64 {
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

#[cfg(test)]
pub fn row(name: &str, state: JobState, done: u64) -> Row {
    let progress = Progress { done, total: 2000, unit: "steps".to_owned(), ..Progress::default() };
    Row {
        name: name.to_owned(),
        state,
        reused: false,
        error: None,
        waits_for: None,
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
    fn a_queued_job_shows_why_it_waits() {
        let mut queued = row("train", JobState::Queued, 0);
        queued.waits_for = Some("from 2026-12-01T08:00:00Z on".to_owned());
        assert_eq!(queued.describe(), "queued, from 2026-12-01T08:00:00Z on");
    }

    #[test]
    fn a_failed_job_shows_its_reason() {
        let mut failed = row("train", JobState::Failed, 500);
        failed.error = Some("loss is not finite".to_owned());
        assert_eq!(failed.describe(), "failed: loss is not finite");
    }
}
