//! Workers: the processes that execute tasks, as they report themselves.

pub(crate) mod demand;
pub(crate) mod duties;
pub(crate) mod placements;

use std::time::Duration;

use spec::Resources;

use crate::database::query::{FromRow, Row, sql};
use crate::database::rows::{resources, text_of_tags};
use crate::database::{Reading, Scope, Transaction};
use crate::{JobId, Store, StoreError, TaskId, Timestamp, boxed};

/// A worker's description of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct WorkerProcess {
    /// Unique among workers. A new worker takes the place of an ended one with the same name.
    pub name: String,
    /// The name of its machine.
    pub host: String,
    /// The id of its process on that machine.
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

/// A worker as it was last seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Worker {
    /// The process and its machine.
    pub process: WorkerProcess,
    /// The moment since when it is drained: it ends its task and claims no other.
    pub drained_at: Option<Timestamp>,
    /// Why it claims no tasks at the moment.
    pub waits_for: Option<String>,
    /// When it began.
    pub started_at: Timestamp,
    /// When it last reported its presence.
    pub seen_at: Timestamp,
    /// Whether it was seen within [`Store::WORKER_SEEN_WITHIN`].
    pub is_alive: bool,
    /// The task that it has.
    pub task: Option<WorkersTask>,
}

/// A task that a worker has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WorkersTask {
    /// Its id.
    pub id: TaskId,
    /// The job that it belongs to.
    pub job: JobId,
    /// A name for people, such as `shard 3`.
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
        tx.set_server(version).await?;
        tx.commit().await
    }

    /// The version of the server that was started last; `None` before the first start.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn server_version(&self) -> Result<Option<String>, StoreError> {
        sql("SELECT version FROM server")
            .optional(&mut self.read("reading the server's version"))
            .await
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn register_worker(&self, new: &WorkerProcess) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Lease, "registering a worker").await?;
        tx.forget_dead_workers(REMEMBER).await?;
        tx.insert_worker(new).await?;
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
        tx.see_worker(worker, waits_for).await?;
        tx.commit().await
    }

    /// Deletes a worker that ends normally.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn forget_worker(&self, worker: &WorkerProcess) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Lease, "forgetting a worker").await?;
        tx.delete_worker(worker).await?;
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
        if !tx.drain_worker(name).await? {
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
        if !tx.undrain_worker(name).await? {
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
        self.read("reading workers").workers(Self::WORKER_SEEN_WITHIN).await
    }
}

impl Reading<'_> {
    /// Workers sorted by name, each with the newest task that it has.
    pub async fn workers(&mut self, seen_within: Duration) -> Result<Vec<Worker>, StoreError> {
        sql("SELECT worker.*, seen_at > {now} - $1 AS is_alive, task.id AS task, task.job, \
             task.label FROM worker LEFT JOIN task ON task.id = (SELECT MAX(id) FROM task \
             WHERE task.state = 'running' AND task.worker = worker.name) ORDER BY worker.name")
        .bind(seen_within)
        .all(self)
        .await
    }

    pub async fn identity(&mut self) -> Result<String, StoreError> {
        sql("SELECT id FROM store").one(self).await
    }
}

impl Transaction {
    pub async fn set_identity(&mut self, identity: &str) -> Result<(), StoreError> {
        sql("UPDATE store SET id = $1").bind(identity).run(self).await
    }

    pub async fn insert_worker(&mut self, new: &WorkerProcess) -> Result<(), StoreError> {
        sql("INSERT INTO worker (name, host, pid, version, device, threads, cpus, gpus, \
             memory_mb, tags, started_at, seen_at) \
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, {now}, {now}) \
             ON CONFLICT (name) DO UPDATE SET host = excluded.host, pid = excluded.pid, version = \
             excluded.version, device = excluded.device, threads = excluded.threads, cpus = \
             excluded.cpus, gpus = excluded.gpus, memory_mb = excluded.memory_mb, tags = \
             excluded.tags, waits_for = NULL, started_at = excluded.started_at, seen_at = \
             excluded.seen_at")
        .bind(&new.name)
        .bind(&new.host)
        .bind(new.pid)
        .bind(&new.version)
        .bind(&new.device)
        .bind(new.threads)
        .bind(new.offers.cpus.unwrap_or(0))
        .bind(new.offers.gpus)
        .bind(new.offers.megabytes())
        .bind(text_of_tags(&new.offers.tags))
        .run(self)
        .await
    }

    /// Does nothing for a worker whose name another one has taken.
    pub async fn see_worker(
        &mut self,
        worker: &WorkerProcess,
        waits_for: Option<&str>,
    ) -> Result<(), StoreError> {
        sql("UPDATE worker SET waits_for = $1, seen_at = {now} WHERE name = $2 AND host = $3 \
             AND pid = $4")
        .bind(waits_for)
        .bind(&worker.name)
        .bind(&worker.host)
        .bind(worker.pid)
        .run(self)
        .await
    }

    /// Returns whether the worker exists. If it is drained already, the time of the drain stays.
    pub async fn drain_worker(&mut self, name: &str) -> Result<bool, StoreError> {
        let drained =
            sql("UPDATE worker SET drained_at = COALESCE(drained_at, {now}) WHERE name = $1")
                .bind(name)
                .changed(self)
                .await?;
        Ok(drained > 0)
    }

    /// Returns whether the worker exists.
    pub async fn undrain_worker(&mut self, name: &str) -> Result<bool, StoreError> {
        let undrained = sql("UPDATE worker SET drained_at = NULL WHERE name = $1")
            .bind(name)
            .changed(self)
            .await?;
        Ok(undrained > 0)
    }

    pub async fn delete_worker(&mut self, worker: &WorkerProcess) -> Result<(), StoreError> {
        sql("DELETE FROM worker WHERE name = $1 AND host = $2 AND pid = $3")
            .bind(&worker.name)
            .bind(&worker.host)
            .bind(worker.pid)
            .run(self)
            .await
    }

    pub async fn forget_dead_workers(&mut self, after: Duration) -> Result<(), StoreError> {
        sql("DELETE FROM worker WHERE seen_at < {now} - $1").bind(after).run(self).await
    }

    pub async fn set_server(&mut self, version: &str) -> Result<(), StoreError> {
        sql("INSERT INTO server (id, version, started_at) VALUES (1, $1, {now}) \
             ON CONFLICT (id) DO UPDATE SET version = excluded.version, started_at = \
             excluded.started_at")
        .bind(version)
        .run(self)
        .await
    }

    /// Writes a row, to test that the database can be written to.
    pub async fn probe(&mut self) -> Result<(), StoreError> {
        sql("INSERT INTO probe (id, written_at) VALUES (1, {now}) ON CONFLICT (id) DO UPDATE \
             SET written_at = excluded.written_at")
        .run(self)
        .await
    }
}

impl FromRow for Worker {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let task: Option<_> = row.get("task")?;
        let task = task.map(|id| {
            Ok::<_, StoreError>(WorkersTask { id, job: row.get("job")?, label: row.get("label")? })
        });
        Ok(Self {
            process: WorkerProcess {
                name: row.get("name")?,
                host: row.get("host")?,
                pid: row.get("pid")?,
                version: row.get("version")?,
                device: row.get("device")?,
                threads: row.get("threads")?,
                offers: resources(row)?,
            },
            drained_at: row.get("drained_at")?,
            waits_for: row.get("waits_for")?,
            started_at: row.get("started_at")?,
            seen_at: row.get("seen_at")?,
            is_alive: row.get("is_alive")?,
            task: task.transpose()?,
        })
    }
}
