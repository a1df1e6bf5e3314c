//! The queue of waiting tasks, and which one is next.

use spec::Resources;
use sqlx::{AssertSqlSafe, Row};

use super::super::dialect::first_in_line;
use super::rows::text_of_tags;
use super::{Database, milliseconds};
use crate::IdlePoll;
use crate::queue::rules::task::LONGEST_DELAY;

impl Database {
    /// Whether there is a task for `worker`, and the version of the server.
    pub async fn poll(&self, worker: &str, offers: &Resources) -> Result<IdlePoll, sqlx::Error> {
        let statement = format!(
            "SELECT EXISTS ({}) AS is_any_claimable, (SELECT version FROM server) AS version",
            first_in_line(&may_be_claimed(), "")
        );
        let mut connection = self.lend().await?;
        let row = sqlx::query(AssertSqlSafe(statement))
            .bind(worker)
            .bind(i64::from(offers.cpus.unwrap_or(0)))
            .bind(i64::from(offers.gpus))
            .bind(i64::from(offers.megabytes()))
            .bind(text_of_tags(&offers.tags))
            .fetch_one(&mut *connection)
            .await?;
        self.take_back(connection);
        Ok(IdlePoll {
            is_any_claimable: row.try_get("is_any_claimable")?,
            server_version: row.try_get("version")?,
        })
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
