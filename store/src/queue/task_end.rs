//! The ways in which a worker gives a task back. Each is one transaction that also updates the job,
//! the jobs that need it and its pipelines.

use serde_json::Value;
use wire::{AttemptOutcome, TaskState};

use crate::boxed;
use crate::database::patience::patiently;
use crate::database::{Scope, StageEnd, Transaction};
use crate::queue::fences;
use crate::queue::fences::lease_lost;
use crate::queue::propagation::advance;
use crate::queue::rules::task::{Ending, TaskStanding};
use crate::{Fence, JobId, Retry, Store, StoreError};

impl Store {
    /// Ends a task that succeeded, with an optional result.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn complete(&self, fence: Fence, result: Option<&Value>) -> Result<(), StoreError> {
        const OPERATION: &str = "completing a task";
        patiently!({
            match self.database().complete_in_stage(fence, result, OPERATION).await? {
                StageEnd::Completed => return Ok(()),
                StageEnd::Lost => return Err(lease_lost(fence)),
                StageEnd::Last => {}
            }
            let completion = Completion::begin(self, fence, OPERATION).await?;
            completion.end(result).await
        })
    }

    /// Ends a task that succeeded before it did all the planned work: `done` was enough.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn complete_early(
        &self,
        fence: Fence,
        done: u64,
        result: &Value,
    ) -> Result<(), StoreError> {
        patiently!({
            let mut completion = Completion::begin(self, fence, "completing a task early").await?;
            completion.tx.set_total(fence.task, done).await?;
            completion.end(Some(result)).await
        })
    }

    /// Ends a task that failed with `error`.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn fail(&self, fence: Fence, error: &str, retry: Retry) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "failing a task").await?;
            give_back(&mut tx, fence, Ending::Failed(retry), Some(error)).await?;
            tx.commit().await
        })
    }

    /// Puts a task back without counting the attempt. A worker that shuts down calls this.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn release(&self, fence: Fence) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "releasing a task").await?;
            give_back(&mut tx, fence, Ending::Released, None).await?;
            tx.commit().await
        })
    }

    /// Puts a task back that found no room for its results. No attempt is counted, and the task
    /// waits a while before it can be claimed again. `reason` is shown until then.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn defer(&self, fence: Fence, reason: &str) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "deferring a task").await?;
            give_back(&mut tx, fence, Ending::Deferred, Some(reason)).await?;
            tx.commit().await
        })
    }

    /// Ends a task that was stopped because its cancellation was requested.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn stopped(&self, fence: Fence) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "cancelling a task").await?;
            give_back(&mut tx, fence, Ending::Stopped, None).await?;
            tx.commit().await
        })
    }
}

/// A transaction that completes a leased task.
///
/// While other tasks of its stage are queued, its job stays as it is, and many tasks complete at a
/// time. One of these tasks later finds no other queued when it ends. It then advances the job,
/// after all concurrent completions have committed.
pub(crate) struct Completion {
    pub tx: Transaction,
    pub job: JobId,
    fence: Fence,
    standing: TaskStanding,
    moves_job: bool,
}

impl Completion {
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost.
    pub async fn begin(
        store: &Store,
        fence: Fence,
        operation: &'static str,
    ) -> Result<Self, StoreError> {
        let mut tx = store.begin(Scope::Task, operation).await?;
        let (mut job, mut standing, stage_goes_on) = fences::held_in_stage(&mut tx, fence).await?;
        if !stage_goes_on && !tx.take_the_queue().await? {
            tx.roll_back().await?;
            tx = store.begin(Scope::Queue, operation).await?;
            (job, standing) = fences::held(&mut tx, fence).await?;
        }
        Ok(Self { tx, job, fence, standing, moves_job: !stage_goes_on })
    }

    /// Completes the task and commits.
    pub async fn end(mut self, result: Option<&Value>) -> Result<(), StoreError> {
        let (standing, _) = self.standing.after(Ending::Completed);
        self.tx.complete_task(self.fence.task, &standing, result).await?;
        if self.moves_job {
            advance(&mut self.tx, self.job).await?;
        }
        self.tx.commit().await
    }
}

/// Takes back a task that was not completed, and returns its new state.
pub(crate) async fn give_back(
    tx: &mut Transaction,
    fence: Fence,
    ending: Ending,
    error: Option<&str>,
) -> Result<TaskState, StoreError> {
    let (job, held) = fences::held(tx, fence).await?;
    let (standing, delay) = held.after(ending);
    let outcome = match ending {
        _ if standing.state == TaskState::Cancelled => AttemptOutcome::Cancelled,
        Ending::Completed => AttemptOutcome::Succeeded,
        Ending::Failed(_) => AttemptOutcome::Failed,
        Ending::Released | Ending::Deferred => AttemptOutcome::Released,
        Ending::Stopped => AttemptOutcome::Cancelled,
    };
    tx.end_attempt(fence, outcome, error).await?;
    let error = match ending {
        _ if standing.state == TaskState::Cancelled => None,
        Ending::Failed(Retry::Allowed) => error
            .map(|error| format!("{error} (attempt {} of {})", held.attempt, held.max_attempts)),
        // The task is not to blame, so it gets no error.
        Ending::Released => None,
        _ => error.map(str::to_owned),
    };
    if standing.state == TaskState::Queued {
        tx.requeue_task(fence.task, &standing, delay, error.as_deref()).await?;
    } else {
        tx.end_task(fence.task, &standing, error.as_deref()).await?;
        advance(tx, job).await?;
    }
    Ok(standing.state)
}
