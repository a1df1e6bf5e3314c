use thiserror::Error;
use wire::{Job, JobState};

/// A job that had to succeed failed or was cancelled.
#[derive(Debug, Error)]
#[error("job {id} {state}: {reason}")]
pub struct JobEnded {
    id: i64,
    state: JobState,
    reason: String,
}

impl JobEnded {
    /// The error of a job that ended without success.
    pub fn new(job: &Job) -> Self {
        Self { id: job.id, state: job.state, reason: failure(job) }
    }
}

/// Why a job did not succeed: the reasons of its members, or its own if it has none.
fn failure(job: &Job) -> String {
    let failed = job.members.iter().filter(|member| member.state == JobState::Failed);
    let reasons: Vec<String> = failed
        .filter_map(|member| Some(format!("{}: {}", member.name, member.error.as_ref()?)))
        .collect();
    match (reasons.is_empty(), &job.error) {
        (true, Some(error)) => error.clone(),
        (true, None) => "no reason given".to_owned(),
        (false, _) => reasons.join("; "),
    }
}
