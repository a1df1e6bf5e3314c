//! Workers, and whether all is well.

use store::WorkerProcess;
use wire::{Health, Worker, WorkersTask};

use crate::app::{App, VERSION};
use crate::error::ApiError;

impl App {
    pub async fn workers(&self) -> Result<Vec<Worker>, ApiError> {
        Ok(self.store.workers().await?.into_iter().map(worker).collect())
    }

    /// Why tasks wait although they could be executed, in sentences; empty when all is well.
    pub async fn obstacles(&self, workers: &[Worker]) -> Result<Vec<String>, ApiError> {
        let mut obstacles = Vec::new();
        if let Some(since) = self.queue().await?.paused_at {
            obstacles
                .push(format!("the queue is paused since {since}; `torqued resume` ends that"));
        }
        if !workers.iter().any(|worker| worker.alive) {
            let nobody = "no worker is alive, so that tasks wait; start one with `torqued worker`";
            obstacles.push(nobody.to_owned());
        }
        obstacles.extend(self.store.obstacle());
        Ok(obstacles)
    }

    /// # Errors
    /// [`ApiError::Unwritable`] when the database cannot be written.
    pub async fn health(&self) -> Result<Health, ApiError> {
        self.store.check_database().await.map_err(ApiError::Unwritable)?;
        let workers = self.workers().await?;
        let reasons = self.obstacles(&workers).await?;
        let status = if reasons.is_empty() { "ok" } else { "degraded" };
        Ok(Health {
            status: status.to_owned(),
            reasons,
            version: VERSION.to_owned(),
            database_schema: self.store.schema_version(),
            workers: workers.iter().filter(|worker| worker.alive).count(),
            free_bytes: self.store.disk_space()?.free_bytes,
        })
    }
}

fn worker(row: store::Worker) -> Worker {
    let WorkerProcess { name, host, pid, version, device, threads } = row.process;
    Worker {
        name,
        host,
        pid,
        version,
        device,
        threads,
        alive: row.is_alive,
        waits_for: row.waits_for,
        task: row.task.map(|task| WorkersTask {
            id: task.id.0,
            job: task.job.0,
            label: task.label,
        }),
        started_at: row.started_at.to_string(),
        seen_at: row.seen_at.to_string(),
    }
}
