//! The line of tasks that wait, and who is next.

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
    /// The task that `worker` is to claim next and that nobody else is about to claim.
    pub async fn next_task(
        &mut self,
        worker: &str,
        offers: &Resources,
    ) -> Result<Option<NextTask>, sqlx::Error> {
        // Of a row that is locked, PostgreSQL shows the newest version.
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
