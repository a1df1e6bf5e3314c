//! The state of a pipeline, which follows from its members' states.

use wire::JobState;

/// The columns of a member that decide about its pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MemberStanding {
    pub state: JobState,
    pub cancel_requested: bool,
}

/// The state of a pipeline, given its present state and whether its cancellation was requested.
///
/// It runs from the start of the first member until the last one ends, even if one fails meanwhile.
/// A cancelled pipeline leaves members to other jobs that need them, and does not wait for those
/// members.
pub(crate) fn settled(
    state: JobState,
    cancel_requested: bool,
    members: &[MemberStanding],
) -> JobState {
    let is_open = |member: &MemberStanding| {
        !member.state.is_final() && (!cancel_requested || member.cancel_requested)
    };
    let has_started =
        |member: &MemberStanding| !matches!(member.state, JobState::Waiting | JobState::Queued);
    let any = |state: JobState| members.iter().any(|member| member.state == state);
    if state.is_final() {
        state
    } else if members.iter().any(is_open) {
        if members.iter().any(has_started) { JobState::Running } else { state }
    } else if members.iter().all(|member| member.state == JobState::Succeeded) {
        JobState::Succeeded
    } else if any(JobState::Failed) && !cancel_requested {
        JobState::Failed
    } else {
        JobState::Cancelled
    }
}

/// The member that is the reason for the pipeline's end: the first that failed, or the first that
/// was cancelled if none failed.
pub(crate) fn culprit(members: &[MemberStanding]) -> Option<usize> {
    let first = |state| members.iter().position(|member| member.state == state);
    first(JobState::Failed).or_else(|| first(JobState::Cancelled))
}
