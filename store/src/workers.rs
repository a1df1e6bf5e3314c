//! The processes that execute tasks, as they show themselves.

use std::time::Duration;

use spec::Resources;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::{JobId, Store, StoreError, TaskId, Timestamp};

/// A worker as it describes itself.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkerProcess {
    /// Unique among workers; another of the name that ended takes its place.
    pub name: String,
    pub host: String,
    pub pid: u32,
    /// The version of torqued.
    pub version: String,
    /// Models are computed on it.
    pub device: String,
    /// Threads for computing.
    pub threads: u32,
    /// It takes tasks that ask for no more.
    pub offers: Resources,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Worker {
    pub process: WorkerProcess,
    /// Since when it is to end the task that it has and claim no other.
    pub drained_at: Option<Timestamp>,
    /// Why it claims no tasks at the moment.
    pub waits_for: Option<String>,
    pub started_at: Timestamp,
    pub seen_at: Timestamp,
    /// Whether it was seen within [`Store::WORKER_SEEN_WITHIN`].
    pub is_alive: bool,
    /// The task that it has.
    pub task: Option<WorkersTask>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkersTask {
    pub id: TaskId,
    pub job: JobId,
    pub label: String,
}

/// How long workers that died are remembered.
pub(crate) const REMEMBER: Duration = Duration::from_secs(24 * 60 * 60);

impl Store {
    /// A worker that was not seen for so long is taken for dead.
    pub const WORKER_SEEN_WITHIN: Duration = Duration::from_secs(30);

    /// Says which version of torqued serves this store from now on.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn register_server(&self, version: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "registering the server").await?;
        sql!(&mut tx, set_server(version))?;
        tx.commit().await
    }

    /// The version of the server that was started last; `None` before the first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn server_version(&self) -> Result<Option<String>, StoreError> {
        sql!(self.database(), "reading the server's version", server_version())
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn register_worker(&self, new: &WorkerProcess) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Lease, "registering a worker").await?;
        sql!(&mut tx, forget_dead_workers(REMEMBER))?;
        sql!(&mut tx, insert_worker(new))?;
        tx.commit().await
    }

    /// Says that a worker is alive, and why it claims no tasks if that is so.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn see_worker(
        &self,
        worker: &WorkerProcess,
        waits_for: Option<&str>,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Statement, "seeing a worker").await?;
        sql!(&mut tx, see_worker(worker, waits_for))?;
        tx.commit().await
    }

    /// Forgets a worker that ends in order.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn forget_worker(&self, worker: &WorkerProcess) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Lease, "forgetting a worker").await?;
        sql!(&mut tx, delete_worker(worker))?;
        tx.commit().await
    }

    /// Has a worker claim no more tasks; it ends the one that it has. That lasts until the worker ends in order, also when
    /// it dies and another takes its name.
    ///
    /// # Errors
    /// When there is no such worker.
    #[boxed]
    pub async fn drain_worker(&self, name: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "draining a worker").await?;
        if !sql!(&mut tx, drain_worker(name))? {
            return Err(StoreError::not_found("worker", name.to_owned()));
        }
        tx.commit().await
    }

    /// Has a worker that was drained claim tasks again.
    ///
    /// # Errors
    /// When there is no such worker.
    #[boxed]
    pub async fn undrain_worker(&self, name: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "ending the drain of a worker").await?;
        if !sql!(&mut tx, undrain_worker(name))? {
            return Err(StoreError::not_found("worker", name.to_owned()));
        }
        tx.commit().await
    }

    /// By name.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn workers(&self) -> Result<Vec<Worker>, StoreError> {
        sql!(self.database(), "reading workers", workers(Self::WORKER_SEEN_WITHIN))
    }
}
