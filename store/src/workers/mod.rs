//! Workers: the processes that execute tasks, as they report themselves.

pub(crate) mod demand;
pub(crate) mod duties;
pub(crate) mod placements;

use std::time::Duration;

use spec::Resources;

use crate::boxed;
use crate::database::{Scope, sql};
use crate::{JobId, Store, StoreError, TaskId, Timestamp};

/// A worker's description of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkerProcess {
    /// Unique among workers. A new worker takes the place of an ended one with the same name.
    pub name: String,
    pub host: String,
    pub pid: u32,
    /// The version of torqued.
    pub version: String,
    /// The device on which it computes models.
    pub device: String,
    /// Number of threads for computing.
    pub threads: u32,
    /// It takes tasks that ask for no more than this.
    pub offers: Resources,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Worker {
    pub process: WorkerProcess,
    /// The moment since when it is drained: it ends its task and claims no other.
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

/// How long dead workers are remembered.
pub(crate) const REMEMBER: Duration = Duration::from_secs(24 * 60 * 60);

impl Store {
    /// A worker that was not seen for this long counts as dead.
    pub const WORKER_SEEN_WITHIN: Duration = Duration::from_secs(30);

    /// Records the version of torqued that serves this store from now on.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn register_server(&self, version: &str) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "registering the server").await?;
        sql!(&mut tx, set_server(version))?;
        tx.commit().await
    }

    /// The version of the server that was started last; `None` before the first start.
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

    /// Records that a worker is alive and, if so, why it claims no tasks.
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

    /// Deletes a worker that ends normally.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn forget_worker(&self, worker: &WorkerProcess) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Lease, "forgetting a worker").await?;
        sql!(&mut tx, delete_worker(worker))?;
        tx.commit().await
    }

    /// Drains a worker: it claims no more tasks, and ends the one that it has. That lasts until it
    /// ends normally, even if it dies and another worker takes its name.
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

    /// Undrains a worker: it claims tasks again.
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

    /// All workers, sorted by name.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn workers(&self) -> Result<Vec<Worker>, StoreError> {
        sql!(self.database(), "reading workers", workers(Self::WORKER_SEEN_WITHIN))
    }
}
