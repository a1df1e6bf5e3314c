//! Takes tasks back from workers that died.

use std::time::Duration;

use wire::TaskState;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::rules::task::Ending;
use crate::rules::watch::{Leased, Watch};
use crate::{Retry, Store, StoreError, task_end};

/// Looks at all leases again and again, and ends those that nobody renews.
#[derive(Debug)]
pub struct Reaper {
    store: Store,
    every: Duration,
    watch: Watch,
}

/// Times the usual pause between two looks that are no pause any more.
const LATE: u32 = 3;

/// The fate of the tasks whose leases ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reaped {
    pub queued: u32,
    pub failed: u32,
    pub cancelled: u32,
}

impl Reaper {
    /// For somebody who means to look once in `every`.
    pub fn new(store: Store, every: Duration) -> Self {
        Self { store, every, watch: Watch::default() }
    }

    /// Looks, `since` after the look before by a clock that never jumps. After a look that comes far too late all
    /// watching begins anew: whoever looks stood still, and the workers perhaps, too.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn look(&mut self, since: Duration) -> Result<Reaped, StoreError> {
        let leased = sql!(self.store.database(), "reading the leases", leased())?;
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
            // Renewed at the last moment, or given back.
            if sql!(&mut tx, lease_until(fence.task))? != Some(until) {
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

/// How a worker ended, as its parent or the engine that placed it saw it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WorkerEnd<'a> {
    /// By itself, and how: completes "worker NAME ...".
    Died(&'a str),
    /// From outside, for which its task is not to blame, and how: completes "worker NAME ...".
    Interrupted(&'a str),
    /// It was told to; its task is no worse for it.
    Stopped,
}

impl Store {
    /// Takes back the tasks of a worker that has ended, without waiting for their leases to run out.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn take_back(&self, worker: &str, end: WorkerEnd<'_>) -> Result<Reaped, StoreError> {
        let mut tx = self.begin(Scope::Queue, "taking back the tasks of a worker").await?;
        let mut reaped = Reaped::default();
        for fence in sql!(&mut tx, leased_by(worker))? {
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
            // It may have put its task down in time, without knowing why it had to.
            sql!(&mut tx, explain_release(worker, &format!("worker {worker} {how}")))?;
        }
        tx.commit().await?;
        Ok(reaped)
    }
}
