//! The line of tasks that wait, and who is next.

use spec::Resources;
use sqlx::{AssertSqlSafe, Row};

use super::super::dialect::first_in_line;
use super::rows::text_of_tags;
use super::{Database, milliseconds};
use crate::Look;
use crate::rules::task::LONGEST_DELAY;

impl Database {
    /// Whether there is a task for `worker`, and the version of the server.
    pub async fn look(&self, worker: &str, offers: &Resources) -> Result<Look, sqlx::Error> {
        let statement = format!(
            "SELECT EXISTS ({}) AS is_any_claimable, (SELECT version FROM server) AS version",
            first_in_line(&may_be_claimed(), "")
        );
        let row = sqlx::query(AssertSqlSafe(statement))
            .bind(worker)
            .bind(i64::from(offers.cpus.unwrap_or(0)))
            .bind(i64::from(offers.gpus))
            .bind(i64::from(offers.megabytes()))
            .bind(text_of_tags(&offers.tags))
            .fetch_one(&self.reader)
            .await?;
        Ok(Look {
            is_any_claimable: row.try_get("is_any_claimable")?,
            server_version: row.try_get("version")?,
        })
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
