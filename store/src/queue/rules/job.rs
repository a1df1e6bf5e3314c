//! The state of a job, which follows from its tasks and from the jobs that it needs.

use wire::JobState;

/// Counts of a job's tasks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct TaskTally {
    /// Whether any failed.
    pub failed: bool,
    /// Whether any was cancelled.
    pub cancelled: bool,
    /// The first stage with a task that has not ended.
    pub open_stage: Option<u32>,
    /// The first stage with a waiting task. Either all tasks of a stage wait, or none.
    pub waiting_stage: Option<u32>,
}

/// The consequence for a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    Nothing,
    /// Its tasks of this stage may be claimed.
    QueueStage(u32),
    /// It ends, and tasks that are still open are stopped.
    End(JobState),
}

/// The first failure ends a job. Otherwise it ends with its last task. A stage begins when all
/// tasks of the stages before have ended.
pub(crate) fn after_task(job: JobState, tasks: TaskTally) -> Step {
    match tasks {
        // The job failed while one of its tasks was still running.
        _ if job.is_final() => Step::Nothing,
        TaskTally { failed: true, .. } => Step::End(JobState::Failed),
        TaskTally { open_stage: Some(stage), waiting_stage, .. } => match waiting_stage {
            Some(waiting) if waiting == stage => Step::QueueStage(stage),
            _ => Step::Nothing,
        },
        TaskTally { cancelled: true, .. } => Step::End(JobState::Cancelled),
        TaskTally { .. } => Step::End(JobState::Succeeded),
    }
}

/// The state of a job that has not begun, from the states of the jobs that it needs.
pub(crate) fn before_start(needs: impl IntoIterator<Item = JobState>) -> JobState {
    let mut state = JobState::Queued;
    for need in needs {
        match need {
            JobState::Succeeded => {}
            JobState::Failed | JobState::Cancelled => return JobState::Cancelled,
            JobState::Waiting | JobState::Queued | JobState::Running => state = JobState::Waiting,
        }
    }
    state
}

/// Whether a job ended without success.
pub(crate) const fn is_unsuccessful(job: JobState) -> bool {
    matches!(job, JobState::Failed | JobState::Cancelled)
}
