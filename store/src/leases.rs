//! Leases: how a worker gets a task, keeps it, and loses it.
//!
//! A claim raises the task's epoch. Whatever the worker writes afterwards names that epoch and
//! changes nothing once it has passed, so a worker that was thought dead cannot do harm.

use std::time::Duration;

use serde_json::Value;
use spec::{Digest, Resources};
use wire::JobState;

use crate::database::{Scope, Transaction, sql};
use crate::rules::task::TaskStanding;
use crate::{Epoch, JobId, RunId, Store, StoreError, TaskId, pipelines};

/// A task and the epoch at which it was claimed: what gives a write its right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Fence {
    pub task: TaskId,
    pub epoch: Epoch,
}

#[derive(Clone, Debug)]
pub struct ClaimedTask {
    pub fence: Fence,
    pub job: JobId,
    /// The job's, opaque to the store.
    pub kind: String,
    /// The job's, resolved.
    pub spec: Value,
    /// The job's.
    pub digest: Digest,
    /// The job's record, if it leaves one.
    pub run: Option<RunId>,
    pub stage: u32,
    pub ordinal: u32,
    pub label: String,
    pub payload: Value,
    pub total: u64,
    /// 1 at the first claim, and at the first after a checkpoint of a later step.
    pub attempt: u32,
    pub max_attempts: u32,
    /// How long an attempt may take.
    pub time_limit: Option<Duration>,
}

/// What a worker tells of a running task.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// In the job's unit, of the task's `total`.
    pub done: u64,
    pub rate_per_second: Option<f64>,
    pub message: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lease {
    Held {
        cancel_requested: bool,
    },
    /// Somebody else may have the task: stop.
    Lost,
}

/// The task that is next to be claimed, as it is before the claim.
#[derive(Clone, Debug)]
pub(crate) struct NextTask {
    pub task: ClaimedTask,
    pub standing: TaskStanding,
    pub job_state: JobState,
}

impl NextTask {
    /// Whether it is the first task of its job that anybody claims.
    pub fn begins_its_job(&self) -> bool {
        self.job_state == JobState::Queued
    }
}

impl Store {
    /// Leases the next task that asks for no more than `worker` offers to it, for `ttl`; the attempt counts from here on.
    /// A worker that is drained gets none.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn claim(
        &self,
        worker: &str,
        offers: &Resources,
        ttl: Duration,
    ) -> Result<Option<ClaimedTask>, StoreError> {
        const OPERATION: &str = "claiming a task";
        // Idle workers ask often; they should not queue for the write lock to learn nothing.
        if !sql!(self.database(), OPERATION, is_any_claimable(worker, offers))? {
            return Ok(None);
        }
        let mut tx = self.begin(Scope::Rows, OPERATION).await?;
        let Some(mut next) = sql!(&mut tx, next_task(worker, offers))? else { return Ok(None) };
        if next.begins_its_job() && !tx.may_move_the_queue() {
            tx.roll_back().await?;
            tx = self.begin(Scope::Queue, OPERATION).await?;
            let Some(found) = sql!(&mut tx, next_task(worker, offers))? else { return Ok(None) };
            next = found;
        }
        let begins_its_job = next.begins_its_job();
        let NextTask { mut task, standing, .. } = next;
        let standing = standing.claimed();
        (task.attempt, task.fence.epoch) = (standing.attempt, standing.epoch);
        sql!(&mut tx, lease(task.fence.task, &standing, worker, ttl))?;
        sql!(&mut tx, begin_attempt(task.job, task.fence, worker))?;
        if begins_its_job && sql!(&mut tx, start_job(task.job))? {
            pipelines::settle_those_of(&mut tx, task.job).await?;
        }
        tx.commit().await?;
        Ok(Some(task))
    }

    /// Prolongs a lease to `ttl` from now and records progress.
    ///
    /// # Errors
    /// When the database fails; a lost lease is an answer, not an error.
    pub async fn renew(
        &self,
        fence: Fence,
        ttl: Duration,
        progress: &Progress,
    ) -> Result<Lease, StoreError> {
        let mut tx = self.begin(Scope::Rows, "renewing a lease").await?;
        let standing = match held(&mut tx, fence).await {
            Ok((_, standing)) => standing,
            Err(StoreError::LeaseLost { .. }) => return Ok(Lease::Lost),
            Err(error) => return Err(error),
        };
        sql!(&mut tx, renew(fence.task, ttl, progress))?;
        tx.commit().await?;
        Ok(Lease::Held { cancel_requested: standing.cancel_requested })
    }
}

/// The job of a leased task, and where the task stands.
///
/// # Errors
/// [`StoreError::LeaseLost`] unless the task is running at the fence's epoch. The answer is good
/// until the transaction ends.
pub(crate) async fn held(
    tx: &mut Transaction,
    fence: Fence,
) -> Result<(JobId, TaskStanding), StoreError> {
    sql!(tx, standing(fence.task))?
        .filter(|(_, standing)| standing.is_held_at(fence.epoch))
        .ok_or(StoreError::LeaseLost { task: fence.task, epoch: fence.epoch })
}

/// The run of a leased task's job.
pub(crate) async fn held_run(tx: &mut Transaction, fence: Fence) -> Result<RunId, StoreError> {
    let (job, _) = held(tx, fence).await?;
    sql!(tx, run_id(job))?.ok_or_else(|| StoreError::not_found("run of job", job.to_string()))
}
