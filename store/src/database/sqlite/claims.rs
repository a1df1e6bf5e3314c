//! Claims. SQLite has one writer, so nothing else changes during a claim.

use std::time::Duration;

use spec::Resources;

use crate::database::Transaction;
use crate::database::query::sql;
use crate::database::rows::text_of_tags;
use crate::queue::rules::task::TaskStanding;
use crate::queue::statements::tasks::NextTask;
use crate::{StoreError, TaskId};

impl Transaction {
    /// Leases the next task to `worker`. Returns it as it was before.
    pub(in crate::database) async fn claim_next(
        &mut self,
        worker: &str,
        offers: &Resources,
        ttl: Duration,
    ) -> Result<Option<NextTask>, StoreError> {
        let next = self.next_task(worker, offers).await?;
        if let Some(next) = &next {
            self.lease(next.task.fence.task, &next.standing.claimed(), worker, ttl).await?;
        }
        Ok(next)
    }

    /// The task that `worker` will claim next.
    pub(super) async fn next_task(
        &mut self,
        worker: &str,
        offers: &Resources,
    ) -> Result<Option<NextTask>, StoreError> {
        sql("SELECT next.*, job.kind, job.spec, job.digest, job.time_limit_s, job.state AS \
             job_state, run.id AS run FROM ({first_in_line}) AS next JOIN job \
             ON job.id = next.job LEFT JOIN run ON run.job = job.id")
        .bind(worker)
        .bind(offers.cpus.unwrap_or(0))
        .bind(offers.gpus)
        .bind(offers.megabytes())
        .bind(text_of_tags(&offers.tags))
        .optional(self)
        .await
    }

    /// Leases a task to `worker` and begins an attempt. The progress of the task begins at 0.
    async fn lease(
        &mut self,
        task: TaskId,
        standing: &TaskStanding,
        worker: &str,
        ttl: Duration,
    ) -> Result<(), StoreError> {
        sql("UPDATE task SET state = $1, attempt = $2, epoch = $3, worker = $4, lease_until = \
             {now} + $6, lease_ms = $6, started_at = COALESCE(started_at, {now}), done = 0, rate \
             = NULL, message = NULL WHERE id = $5; INSERT INTO attempt (job, task, epoch, worker, \
             started_at) SELECT job, id, $3, $4, {now} FROM task WHERE id = $5")
        .bind(standing.state)
        .bind(standing.attempt)
        .bind(standing.epoch)
        .bind(worker)
        .bind(task)
        .bind(ttl)
        .run(self)
        .await
    }
}
