//! The outcome of a verification in words.

use wire::{JobState, Verification};

use crate::app::verifications::Agreement;
use crate::page::instant::Instant;
use crate::page::text;

/// A description of the newest verification of a dataset.
pub struct Checked {
    /// The job of the verification; `None` if there was none.
    pub job: Option<i64>,
    pub state: JobState,
    /// When it ended.
    pub at: Option<Instant>,
    pub outcome: String,
    pub remarks: Vec<String>,
    /// The first difference.
    pub error: String,
    /// Whether the result will not change by itself.
    pub settled: bool,
}

impl Checked {
    pub fn new(verification: Option<&Verification>) -> Self {
        let Some(found) = verification else {
            return Self {
                job: None,
                state: JobState::Waiting,
                at: None,
                outcome: "Not verified yet: every shard would be made again and compared with \
                          what is stored."
                    .to_owned(),
                remarks: Vec::new(),
                error: String::new(),
                settled: true,
            };
        };
        let outcome = outcome(Agreement {
            shards: found.shards,
            verified: found.shards_verified,
            identical: found.shards_identical,
        });
        Self {
            job: Some(found.job),
            state: found.state,
            at: found.finished_at.as_deref().map(Instant::new),
            outcome: match found.state {
                JobState::Succeeded => format!("Verified: {outcome}."),
                JobState::Failed => "Failed.".to_owned(),
                JobState::Cancelled => format!("Cancelled: {outcome}."),
                JobState::Waiting | JobState::Queued | JobState::Running => outcome,
            },
            remarks: found.remarks.clone(),
            error: found.error.clone().unwrap_or_default(),
            settled: found.state.is_final(),
        }
    }
}

/// How many shards agree, and how well.
pub fn outcome(Agreement { shards, verified, identical }: Agreement) -> String {
    let all = verified == shards;
    let compared = match (all, shards) {
        (true, 1) => "the one shard".to_owned(),
        (true, _) => format!("all {} shards", text::count(shards)),
        (false, _) => format!("{} of {} shards", text::count(verified), text::count(shards)),
    };
    let agree = if shards == 1 && all { "agrees" } else { "agree" };
    if verified == identical {
        return format!("{compared} {agree} in every byte");
    }
    let identical = text::count(identical);
    format!("{compared} {agree} in every value, {identical} of them in every byte")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(shards: u64, verified: u64, identical: u64) -> String {
        outcome(Agreement { shards, verified, identical })
    }

    #[test]
    fn an_outcome_says_how_many_agree_and_how_well() {
        assert_eq!(found(1, 1, 1), "the one shard agrees in every byte");
        assert_eq!(found(3, 3, 3), "all 3 shards agree in every byte");
        assert_eq!(found(3, 0, 0), "0 of 3 shards agree in every byte");
        assert_eq!(found(3, 3, 1), "all 3 shards agree in every value, 1 of them in every byte");
    }
}
