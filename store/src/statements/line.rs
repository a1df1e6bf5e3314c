//! The queue of waiting tasks, and which one is next.

use spec::Resources;
use sqlx::types::Text;
use sqlx::{AssertSqlSafe, FromRow, Row};

use super::super::dialect::{LOCKED_OR_SKIPPED, first_in_line};
use super::rows::text_of_tags;
use super::{Database, DbRow, Transaction, milliseconds};
use crate::ClaimedTask;
use crate::leases::NextTask;
use crate::rules::task::{LONGEST_DELAY, TaskStanding};

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
    /// The task that `worker` will claim next. Tasks that another worker is about to claim are
    /// skipped.
    pub async fn next_task(
        &mut self,
        worker: &str,
        offers: &Resources,
    ) -> Result<Option<NextTask>, sqlx::Error> {
        // PostgreSQL returns the newest version of a locked row.
        let statement = format!(
            "SELECT next.*, job.kind, job.spec, job.digest, job.time_limit_s, job.state AS job_state, \
             run.id AS run FROM ({}) AS next JOIN job ON job.id = next.job \
             LEFT JOIN run ON run.job = job.id",
            first_in_line(&may_be_claimed(), LOCKED_OR_SKIPPED)
        );
        let row: Option<DbRow> = sqlx::query(AssertSqlSafe(statement))
            .bind(worker)
            .bind(i64::from(offers.cpus.unwrap_or(0)))
            .bind(i64::from(offers.gpus))
            .bind(i64::from(offers.megabytes()))
            .bind(text_of_tags(&offers.tags))
            .fetch_optional(self.connection())
            .await?;
        let Some(row) = row else { return Ok(None) };
        let Text(job_state) = row.try_get("job_state")?;
        Ok(Some(NextTask {
            task: ClaimedTask::from_row(&row)?,
            standing: TaskStanding::from_row(&row)?,
            job_state,
        }))
    }
}

/// The condition that a task may be claimed, at once or after its delay. The queue must not be
/// paused, and the job's start time must have come. A delay that ends later than the longest
/// possible one was set by a clock that was set back since; it is ignored. The job's start time was
/// set by its user and always counts.
pub(crate) fn may_be_claimed() -> String {
    format!(
        "state = 'queued' AND (SELECT paused_at FROM queue) IS NULL AND not_before <= {now} \
         AND (run_at <= {now} OR run_at > {now} + {longest})",
        now = now!(),
        longest = milliseconds(LONGEST_DELAY)
    )
}
