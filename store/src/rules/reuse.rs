//! Earlier work that stands in for a new job of the same digest.

use wire::JobState;

use crate::JobId;

/// A job of the digest that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Earlier {
    pub job: JobId,
    pub state: JobState,
    pub cancel_requested: bool,
    /// Whether it is a pipeline of which a member failed or was cancelled.
    pub can_only_fail: bool,
}

/// The job that stands in for a new one: of those that succeeded the newest, or else the newest
/// that still may.
pub(crate) fn stand_in(earlier: &[Earlier]) -> Option<JobId> {
    let may_succeed =
        |job: &&Earlier| !job.state.is_final() && !job.cancel_requested && !job.can_only_fail;
    let newest = |jobs: &mut dyn Iterator<Item = &Earlier>| jobs.map(|job| job.job).max();
    newest(&mut earlier.iter().filter(|job| job.state == JobState::Succeeded))
        .or_else(|| newest(&mut earlier.iter().filter(may_succeed)))
}

/// A task that is the same in every job of a digest, if its payload is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TaskPlace {
    pub stage: u32,
    pub ordinal: u32,
}

/// Whether a task takes over what an earlier one at its place left. The last stage is always done
/// again, for what it leaves belongs to the new job's run.
pub(crate) fn takes_over(place: TaskPlace, last_stage: u32, same_payload: bool) -> bool {
    place.stage < last_stage && same_payload
}
