//! Claims. SQLite has one writer, so nothing else changes during a claim.

use std::time::Duration;

use spec::Resources;
use sqlx::{AssertSqlSafe, FromRow};

use super::dialect::first_in_line;
use super::statements::line::may_be_claimed;
use super::statements::milliseconds;
use super::statements::rows::text_of_tags;
use super::{Database, Transaction};
use crate::database::Scope;
use crate::queue::leases::NextTask;
use crate::queue::rules::task::TaskStanding;
use crate::{StoreError, TaskId};

impl Database {
    /// Leases the next task to `worker`. Returns it as it was before, and the transaction, which the
    /// caller commits.
    pub async fn claim(
        &self,
        worker: &str,
        offers: &Resources,
        ttl: Duration,
        operation: &'static str,
    ) -> Result<Option<(NextTask, Transaction)>, StoreError> {
        let mut tx = self.begin(Scope::Lease, operation).await?;
        let claimed = tx.claim(worker, offers, ttl).await;
        let claimed = claimed.map_err(StoreError::database(operation))?;
        Ok(claimed.map(|next| (next, tx)))
    }
}

impl Transaction {
    async fn claim(
        &mut self,
        worker: &str,
        offers: &Resources,
        ttl: Duration,
    ) -> Result<Option<NextTask>, sqlx::Error> {
        let next = self.next_task(worker, offers).await?;
        if let Some(next) = &next {
            self.lease(next.task.fence.task, &next.standing.claimed(), worker, ttl).await?;
        }
        Ok(next)
    }

    /// The task that `worker` will claim next.
    pub async fn next_task(
        &mut self,
        worker: &str,
        offers: &Resources,
    ) -> Result<Option<NextTask>, sqlx::Error> {
        let statement = format!(
            "SELECT next.*, job.kind, job.spec, job.digest, job.time_limit_s, job.state AS job_state, \
             run.id AS run FROM ({}) AS next JOIN job ON job.id = next.job \
             LEFT JOIN run ON run.job = job.id",
            first_in_line(&may_be_claimed(), "")
        );
        let row = sqlx::query(AssertSqlSafe(statement))
            .bind(worker)
            .bind(i64::from(offers.cpus.unwrap_or(0)))
            .bind(i64::from(offers.gpus))
            .bind(i64::from(offers.megabytes()))
            .bind(text_of_tags(&offers.tags))
            .fetch_optional(self.connection())
            .await?;
        row.map(|row| NextTask::from_row(&row)).transpose()
    }

    /// Leases a task to `worker` and begins an attempt. The progress of the task begins at 0.
    async fn lease(
        &mut self,
        task: TaskId,
        standing: &TaskStanding,
        worker: &str,
        ttl: Duration,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE task SET state = $1, attempt = $2, epoch = $3, worker = $4, lease_until = ",
            now!(),
            " + $6, lease_ms = $6, started_at = COALESCE(started_at, ",
            now!(),
            "), done = 0, rate = NULL, message = NULL WHERE id = $5; \
             INSERT INTO attempt (job, task, epoch, worker, started_at) SELECT job, id, $3, $4, ",
            now!(),
            " FROM task WHERE id = $5"
        ))
        .bind(standing.state.as_str())
        .bind(i64::from(standing.attempt))
        .bind(standing.epoch)
        .bind(worker)
        .bind(task)
        .bind(milliseconds(ttl));
        self.execute(statement).await
    }
}
