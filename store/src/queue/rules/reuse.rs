//! Reuse: earlier jobs that stand in for a new job with the same digest.

use wire::JobState;

use crate::JobId;

/// A job with the requested digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Earlier {
    pub job: JobId,
    pub state: JobState,
    pub cancel_requested: bool,
    /// Whether it is a pipeline with a member that failed or was cancelled.
    pub can_only_fail: bool,
}

/// The job that stands in for a new one: the newest that succeeded, or if there is none, the newest
/// that can still succeed.
pub(crate) fn stand_in(earlier: &[Earlier]) -> Option<JobId> {
    let may_succeed =
        |job: &&Earlier| !job.state.is_final() && !job.cancel_requested && !job.can_only_fail;
    let newest = |jobs: &mut dyn Iterator<Item = &Earlier>| jobs.map(|job| job.job).max();
    newest(&mut earlier.iter().filter(|job| job.state == JobState::Succeeded))
        .or_else(|| newest(&mut earlier.iter().filter(may_succeed)))
}

/// The place of a task. Tasks at the same place of jobs with the same digest are the same if their
/// payloads are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TaskPlace {
    pub stage: u32,
    pub ordinal: u32,
}

/// Whether a task takes over the result of an earlier task at its place. The last stage always runs
/// again, because its results belong to the new job's run.
pub(crate) fn takes_over(place: TaskPlace, last_stage: u32, same_payload: bool) -> bool {
    place.stage < last_stage && same_payload
}
