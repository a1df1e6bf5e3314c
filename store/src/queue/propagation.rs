//! The consequences of a task's end: its job advances, jobs that need it are queued or cancelled,
//! and pipelines settle. All this happens in the transaction that ended the task.

use wire::JobState;

use crate::database::Transaction;
use crate::queue::pipelines;
use crate::queue::rules::job::{Step, after_task, before_start};
use crate::{JobId, StoreError};

/// Advances a job after it was queued, or after some of its tasks ended.
pub(crate) async fn advance(tx: &mut Transaction, job: JobId) -> Result<(), StoreError> {
    let state = state_of(tx, job).await?;
    match after_task(state, tx.tally(job).await?) {
        Step::Nothing => Ok(()),
        Step::QueueStage(stage) => tx.queue_stage(job, stage).await,
        Step::End(state) => {
            let error = match state {
                JobState::Failed => tx.first_failure(job).await?,
                _ => None,
            };
            finish(tx, job, state, error).await
        }
    }
}

/// Ends a job whose cancellation was requested, unless workers still have some of its tasks.
pub(crate) async fn stop(tx: &mut Transaction, job: JobId) -> Result<(), StoreError> {
    tx.stop_tasks(job).await?;
    advance(tx, job).await
}

/// The state of a job that a row names, so it exists.
pub(crate) async fn state_of(tx: &mut Transaction, job: JobId) -> Result<JobState, StoreError> {
    tx.job_state(job).await?.ok_or_else(|| StoreError::not_found("job", job.to_string()))
}

/// Gives a job its final state, and informs everything that depends on it.
async fn finish(
    tx: &mut Transaction,
    job: JobId,
    state: JobState,
    error: Option<String>,
) -> Result<(), StoreError> {
    let mut finishing = vec![(job, state, error)];
    while let Some((job, state, error)) = finishing.pop() {
        if state_of(tx, job).await?.is_final() {
            continue;
        }
        tx.stop_tasks(job).await?;
        tx.end_job(job, state, error.as_deref()).await?;
        if state == JobState::Succeeded {
            tx.complete_dataset(job).await?;
        }
        for dependent in tx.waiting_dependents(job).await? {
            match before_start(tx.states_of_needs(dependent).await?) {
                JobState::Queued => {
                    tx.queue_job(dependent).await?;
                    let stage = tx.tally(dependent).await?.open_stage;
                    tx.queue_stage(dependent, stage.unwrap_or(0)).await?;
                }
                JobState::Cancelled => {
                    let reason = format!("needs job {job}, which {}", past_tense(state));
                    finishing.push((dependent, JobState::Cancelled, Some(reason)));
                }
                _ => {}
            }
        }
        pipelines::settle_pipelines_of(tx, job).await?;
    }
    Ok(())
}

const fn past_tense(state: JobState) -> &'static str {
    match state {
        JobState::Failed => "failed",
        _ => "was cancelled",
    }
}
