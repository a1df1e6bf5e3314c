//! Workers, and the health of the service.

use store::WorkerProcess;
use wire::{Health, Placement, Readiness, Worker, Workers, WorkersTask};

use crate::app::jobs::text;
use crate::app::waits::sentence;
use crate::app::{App, VERSION};
use crate::error::ApiError;

impl App {
    pub(crate) async fn workers(&self) -> Result<Workers, ApiError> {
        let mut workers: Vec<Worker> =
            self.store.workers().await?.into_iter().map(worker).collect();
        let mut placements = Vec::new();
        for placement in self.store.placements().await?.into_iter().map(placement) {
            match workers.iter_mut().find(|worker| worker.name == placement.worker) {
                Some(worker) => worker.placement = Some(placement),
                None => placements.push(placement),
            }
        }
        Ok(Workers { workers, placements })
    }

    /// Sentences about why tasks wait although they could be executed. Empty if all is well.
    pub(crate) async fn obstacles(&self, workers: &[Worker]) -> Result<Vec<String>, ApiError> {
        let mut obstacles = Vec::new();
        if let Some(since) = self.queue().await?.paused_at {
            obstacles.push(format!(
                "the queue is paused since {since}; resume it with `torqued resume`"
            ));
        }
        let engine = self.store.engine().await?;
        let are_alive = workers.iter().any(|worker| worker.alive);
        let are_free = workers.iter().any(|worker| worker.alive && worker.drained_at.is_none());
        if engine.is_some() {
            // The engine provides missing workers. If that fails, it has an obstacle of its own.
        } else if !are_alive {
            let nobody = "tasks wait, because no worker is alive; start one with `torqued worker`";
            obstacles.push(nobody.to_owned());
        } else if !are_free {
            let nobody = "tasks wait, because every worker is drained; undrain one with `torqued undrain \
                 NAME`";
            obstacles.push(nobody.to_owned());
        } else if let Some(wait) = self.store.why_all_wait().await? {
            let why = sentence(&wait, None);
            obstacles.push(format!("no worker can take any waiting task: {why}"));
        }
        obstacles.extend(engine.and_then(|engine| engine.obstacle));
        obstacles.extend(self.store.obstacle());
        Ok(obstacles)
    }

    /// Drains a worker: it claims no more tasks, and ends the one that it has.
    pub(crate) async fn drain_worker(&self, name: &str) -> Result<Worker, ApiError> {
        self.store.drain_worker(name).await?;
        self.worker(name).await
    }

    /// Undrains a worker: it claims tasks again.
    pub(crate) async fn undrain_worker(&self, name: &str) -> Result<Worker, ApiError> {
        self.store.undrain_worker(name).await?;
        self.worker(name).await
    }

    async fn worker(&self, name: &str) -> Result<Worker, ApiError> {
        let Workers { workers, .. } = self.workers().await?;
        let found = workers.into_iter().find(|worker| worker.name == name);
        found.ok_or_else(|| ApiError::not_found("worker", name))
    }

    /// # Errors
    /// [`ApiError::Ending`] when the server is about to stop. [`ApiError::Unwritable`] when the
    /// database cannot be written.
    pub(crate) async fn readiness(&self) -> Result<Readiness, ApiError> {
        if self.places.is_ending() {
            return Err(ApiError::Ending);
        }
        self.store.check_database().await.map_err(ApiError::Unwritable)?;
        Ok(Readiness { status: "ready".to_owned() })
    }

    /// # Errors
    /// [`ApiError::Unwritable`] when the database cannot be written.
    pub(crate) async fn health(&self) -> Result<Health, ApiError> {
        self.store.check_database().await.map_err(ApiError::Unwritable)?;
        let workers = self.workers().await?.workers;
        let reasons = self.obstacles(&workers).await?;
        let status = if reasons.is_empty() { "ok" } else { "degraded" };
        Ok(Health {
            status: status.to_owned(),
            reasons,
            version: VERSION.to_owned(),
            database_schema: self.store.schema_version(),
            workers: workers.iter().filter(|worker| worker.alive).count(),
            free_bytes: self.free_bytes()?,
        })
    }

    /// Free space on the disk of the data folder.
    pub(crate) fn free_bytes(&self) -> Result<u64, ApiError> {
        Ok(self.store.disk_space()?.free_bytes)
    }
}

fn worker(row: store::Worker) -> Worker {
    let WorkerProcess { name, host, pid, version, device, threads, offers } = row.process;
    Worker {
        name,
        host,
        pid,
        version,
        device,
        threads,
        offers,
        alive: row.is_alive,
        drained_at: text(row.drained_at),
        waits_for: row.waits_for,
        task: row.task.map(|task| WorkersTask {
            id: task.id.0,
            job: task.job.0,
            label: task.label,
        }),
        placement: None,
        started_at: row.started_at.to_string(),
        seen_at: row.seen_at.to_string(),
    }
}

fn placement(row: store::Placement) -> Placement {
    let store::Placed { worker, engine, identifier, state, reason, node } = row.placed;
    Placement {
        worker,
        engine,
        identifier,
        state,
        reason,
        node,
        asked_at: row.asked_at.to_string(),
        changed_at: row.changed_at.to_string(),
    }
}
