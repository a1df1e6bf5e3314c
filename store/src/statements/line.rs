//! The line of tasks that wait, and who is next.

use spec::Resources;
use sqlx::types::Text;
use sqlx::{AssertSqlSafe, FromRow, Row};

use super::super::dialect::{LOCKED_OR_SKIPPED, first_in_line};
use super::rows::text_of_tags;
use super::{Database, DbRow, Transaction, milliseconds};
use crate::leases::NextTask;
use crate::rules::task::{LONGEST_DELAY, TaskStanding};
use crate::{ClaimedTask, TaskId};

impl Database {
    /// Whether there is a task for `worker`.
    pub async fn is_any_claimable(
        &self,
        worker: &str,
        offers: &Resources,
    ) -> Result<bool, sqlx::Error> {
        let statement = format!("SELECT EXISTS ({})", first_in_line(&may_be_claimed(), ""));
        sqlx::query_scalar(AssertSqlSafe(statement))
            .bind(worker)
            .bind(i64::from(offers.cpus.unwrap_or(0)))
            .bind(i64::from(offers.gpus))
            .bind(i64::from(offers.megabytes()))
            .bind(text_of_tags(&offers.tags))
            .fetch_one(&self.reader)
            .await
    }
}

impl Transaction {
    /// The task that `worker` is to claim next and that nobody else is about to claim.
    pub async fn next_task(
        &mut self,
        worker: &str,
        offers: &Resources,
    ) -> Result<Option<NextTask>, sqlx::Error> {
        let statement = first_in_line(&may_be_claimed(), LOCKED_OR_SKIPPED);
        let first: Option<TaskId> = sqlx::query_scalar(AssertSqlSafe(statement))
            .bind(worker)
            .bind(i64::from(offers.cpus.unwrap_or(0)))
            .bind(i64::from(offers.gpus))
            .bind(i64::from(offers.megabytes()))
            .bind(text_of_tags(&offers.tags))
            .fetch_optional(self.connection())
            .await?;
        let Some(first) = first else { return Ok(None) };
        // Read once it is locked: it may have been claimed and given back since it was found.
        let row: DbRow = sqlx::query(
            "SELECT task.*, job.kind, job.spec, job.digest, job.time_limit_s, \
             job.state AS job_state, run.id AS run FROM task JOIN job ON job.id = task.job \
             LEFT JOIN run ON run.job = job.id WHERE task.id = $1",
        )
        .bind(first)
        .fetch_one(self.connection())
        .await?;
        let Text(job_state) = row.try_get("job_state")?;
        Ok(Some(NextTask {
            task: ClaimedTask::from_row(&row)?,
            standing: TaskStanding::from_row(&row)?,
            job_state,
        }))
    }
}

/// The condition of a task that may be claimed at once (0) or after a delay, of a job that may begin, unless the queue is
/// paused. A delay that ends farther ahead than any lasts was set by a clock that went back since. A job's moment is
/// what its user said, and waited for whatever the clock does.
pub(crate) fn may_be_claimed() -> String {
    format!(
        "state = 'queued' AND (SELECT paused_at FROM queue) IS NULL AND not_before <= {now} \
         AND (run_at <= {now} OR run_at > {now} + {longest})",
        now = now!(),
        longest = milliseconds(LONGEST_DELAY)
    )
}
