//! Attempts at tasks.

use store::JobId;
use wire::{Attempt, Attempts};

use crate::app::jobs::text;
use crate::app::{App, Paging};
use crate::error::ApiError;

impl App {
    /// # Errors
    /// When there is no such job.
    pub(crate) async fn attempts(&self, job: i64, paging: Paging) -> Result<Attempts, ApiError> {
        self.store.job(JobId(job)).await?;
        let rows = self.store.attempts(JobId(job), paging.into()).await?;
        let next = paging.next(rows.len(), rows.last().map(|row| row.id));
        Ok(Attempts { attempts: rows.into_iter().map(attempt).collect(), next })
    }
}

fn attempt(row: store::Attempt) -> Attempt {
    Attempt {
        id: row.id,
        task: row.task.0,
        label: row.label,
        epoch: row.epoch.0,
        worker: row.worker,
        outcome: row.outcome,
        reason: row.reason,
        started_at: row.started_at.to_string(),
        ended_at: text(row.ended_at),
        log: row.log_bytes.map(|_| format!("/v1/attempts/{}/log", row.id)),
    }
}
