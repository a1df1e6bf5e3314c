//! Takes tasks back from workers that died.

use std::time::Duration;

use wire::TaskState;

use crate::boxed;
use crate::database::Scope;
use crate::queue::rules::task::Ending;
use crate::queue::rules::watch::{Leased, Watch};
use crate::queue::task_end;
use crate::{Retry, Store, StoreError};

/// Checks all leases regularly, and ends those that nobody renews.
#[derive(Debug)]
pub struct Reaper {
    store: Store,
    every: Duration,
    watch: Watch,
}

/// A pause between two looks that is this many times the usual one counts as a standstill.
const LATE: u32 = 3;

/// The tasks whose leases ended, by their new states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reaped {
    /// Tasks that other workers may claim now.
    pub queued: u32,
    /// Tasks that have no attempt left.
    pub failed: u32,
    /// Tasks of jobs that were being cancelled.
    pub cancelled: u32,
}

impl Reaper {
    /// A reaper that is meant to look once in `every`.
    pub fn new(store: Store, every: Duration) -> Self {
        Self { store, every, watch: Watch::default() }
    }

    /// Checks the leases. `since` is the time since the last look, by a clock that never jumps.
    /// After a look that comes far too late, all watching begins anew: this process stood still,
    /// and perhaps the workers did too.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn look(&mut self, since: Duration) -> Result<Reaped, StoreError> {
        let leased = self.store.read("reading the leases").leased().await?;
        if since > LATE * self.every {
            self.watch.begin_anew();
        }
        let ended = self.watch.look(leased, since);
        if ended.is_empty() {
            return Ok(Reaped::default());
        }
        let mut tx =
            self.store.begin(Scope::Queue, "taking back the tasks of dead workers").await?;
        let mut reaped = Reaped::default();
        for Leased { fence, worker, until, .. } in ended {
            // The lease was renewed at the last moment, or given back.
            if tx.lease_until(fence.task).await? != Some(until) {
                continue;
            }
            let error = format!("worker {worker} stopped answering");
            let ending = Ending::Failed(Retry::Allowed);
            match task_end::give_back(&mut tx, fence, ending, Some(&error)).await {
                Ok(state) => reaped.count(state),
                Err(StoreError::LeaseLost { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        tx.commit().await?;
        Ok(reaped)
    }
}

impl Reaped {
    fn count(&mut self, state: TaskState) {
        match state {
            TaskState::Failed => self.failed += 1,
            TaskState::Cancelled => self.cancelled += 1,
            _ => self.queued += 1,
        }
    }
}

/// How a worker ended, in the view of its parent or of the engine that placed it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorkerEnd<'a> {
    /// By itself. The text completes "worker NAME ...".
    Died(&'a str),
    /// By an outside cause that its task is not to blame for. The text completes "worker NAME ...".
    Interrupted(&'a str),
    /// It was told to stop. Its task is not to blame.
    Stopped,
}

impl Store {
    /// Takes back the tasks of a worker that has ended, without waiting for their leases to expire.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn take_back(&self, worker: &str, end: WorkerEnd<'_>) -> Result<Reaped, StoreError> {
        let mut tx = self.begin(Scope::Queue, "taking back the tasks of a worker").await?;
        let mut reaped = Reaped::default();
        for fence in tx.leased_by(worker).await? {
            let (ending, error) = match end {
                WorkerEnd::Died(how) => {
                    (Ending::Failed(Retry::Allowed), Some(format!("worker {worker} {how}")))
                }
                WorkerEnd::Interrupted(how) => {
                    (Ending::Released, Some(format!("worker {worker} {how}")))
                }
                WorkerEnd::Stopped => (Ending::Released, None),
            };
            reaped.count(task_end::give_back(&mut tx, fence, ending, error.as_deref()).await?);
        }
        if let WorkerEnd::Interrupted(how) | WorkerEnd::Died(how) = end {
            // The worker may have given its task back in time, without knowing why it had to.
            tx.explain_release(worker, &format!("worker {worker} {how}")).await?;
        }
        tx.commit().await?;
        Ok(reaped)
    }
}
