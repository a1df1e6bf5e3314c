//! The members that are cancelled together with their pipeline.

use std::collections::BTreeSet;

use wire::JobState;

use crate::JobId;

/// The facts that decide about a member.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Candidate {
    pub job: JobId,
    pub state: JobState,
    /// Whether somebody asked for the member by itself.
    pub asked_alone: bool,
    /// Whether another active pipeline has it too.
    pub is_shared: bool,
    /// The jobs that wait for it.
    pub needed_by: Vec<JobId>,
}

/// The members that have not ended and that no other active job needs.
pub(crate) fn members_to_cancel(members: &[Candidate]) -> BTreeSet<JobId> {
    let is_free =
        |member: &&Candidate| !member.state.is_final() && !member.asked_alone && !member.is_shared;
    let mut cancelled: BTreeSet<JobId> =
        members.iter().filter(is_free).map(|member| member.job).collect();
    loop {
        let before = cancelled.len();
        for member in members {
            if member.needed_by.iter().any(|job| !cancelled.contains(job)) {
                cancelled.remove(&member.job);
            }
        }
        if cancelled.len() == before {
            return cancelled;
        }
    }
}
