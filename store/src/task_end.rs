//! The ways in which a worker gives a task back. Each is one transaction together with what
//! follows for the job, the jobs that need it and the pipelines it is in.

use serde_json::Value;
use wire::{AttemptOutcome, TaskState};

use crate::database::{Scope, Transaction, sql};
use crate::patience::patiently;
use crate::propagation::advance;
use crate::rules::task::{Ending, TaskStanding};
use crate::{Fence, JobId, Retry, Store, StoreError, TaskId, leases};

impl Store {
    /// The task succeeded, with an optional result.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn complete(&self, fence: Fence, result: Option<&Value>) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "completing a task").await?;
            let (job, standing) = leases::held(&mut tx, fence).await?;
            complete(&mut tx, fence.task, job, standing, result).await?;
            tx.commit().await
        })
    }

    /// The task succeeded before all that was planned was done: `done` was enough.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn complete_early(
        &self,
        fence: Fence,
        done: u64,
        result: &Value,
    ) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "completing a task early").await?;
            let (job, standing) = leases::held(&mut tx, fence).await?;
            sql!(&mut tx, set_total(fence.task, done))?;
            complete(&mut tx, fence.task, job, standing, Some(result)).await?;
            tx.commit().await
        })
    }

    /// The task failed with `error`.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn fail(&self, fence: Fence, error: &str, retry: Retry) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "failing a task").await?;
            give_back(&mut tx, fence, Ending::Failed(retry), Some(error)).await?;
            tx.commit().await
        })
    }

    /// Puts the task back without counting the attempt, as a worker that shuts down does.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn release(&self, fence: Fence) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "releasing a task").await?;
            give_back(&mut tx, fence, Ending::Released, None).await?;
            tx.commit().await
        })
    }

    /// The task was stopped because its cancellation was requested.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn stopped(&self, fence: Fence) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Queue, "cancelling a task").await?;
            give_back(&mut tx, fence, Ending::Stopped, None).await?;
            tx.commit().await
        })
    }
}

/// Completes a task that is held.
pub(crate) async fn complete(
    tx: &mut Transaction,
    task: TaskId,
    job: JobId,
    standing: TaskStanding,
    result: Option<&Value>,
) -> Result<(), StoreError> {
    let (standing, _) = standing.after(Ending::Completed);
    sql!(tx, complete_task(task, &standing, result))?;
    let fence = Fence { task, epoch: standing.epoch };
    sql!(tx, end_attempt(fence, AttemptOutcome::Succeeded, None))?;
    advance(tx, job).await
}

/// Takes a task back that was not completed, and says what became of it.
pub(crate) async fn give_back(
    tx: &mut Transaction,
    fence: Fence,
    ending: Ending,
    error: Option<&str>,
) -> Result<TaskState, StoreError> {
    let (job, held) = leases::held(tx, fence).await?;
    let (standing, delay) = held.after(ending);
    let outcome = match ending {
        _ if standing.state == TaskState::Cancelled => AttemptOutcome::Cancelled,
        Ending::Completed => AttemptOutcome::Succeeded,
        Ending::Failed(_) => AttemptOutcome::Failed,
        Ending::Released => AttemptOutcome::Released,
        Ending::Stopped => AttemptOutcome::Cancelled,
    };
    sql!(tx, end_attempt(fence, outcome, error))?;
    let error = match ending {
        _ if standing.state == TaskState::Cancelled => None,
        Ending::Failed(Retry::Allowed) => error
            .map(|error| format!("{error} (attempt {} of {})", held.attempt, held.max_attempts)),
        // The task is no worse for it.
        Ending::Released => None,
        _ => error.map(str::to_owned),
    };
    if standing.state == TaskState::Queued {
        sql!(tx, requeue_task(fence.task, &standing, delay, error.as_deref()))?;
    } else {
        sql!(tx, end_task(fence.task, &standing, error.as_deref()))?;
        advance(tx, job).await?;
    }
    Ok(standing.state)
}
