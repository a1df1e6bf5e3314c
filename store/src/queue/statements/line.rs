//! The queue of waiting tasks, and which one is next.

use spec::Resources;

use crate::database::Reading;
use crate::database::column::milliseconds;
use crate::database::query::sql;
use crate::database::rows::text_of_tags;
use crate::queue::rules::task::LONGEST_DELAY;
use crate::{IdlePoll, StoreError};

impl Reading<'_> {
    /// Whether there is a task for `worker`, and the version of the server.
    pub async fn poll(&mut self, worker: &str, offers: &Resources) -> Result<IdlePoll, StoreError> {
        let (is_any_claimable, server_version) = sql(
            "SELECT EXISTS ({first_in_line}) AS is_any_claimable, (SELECT version FROM server) AS version",
        )
        .bind(worker)
        .bind(offers.cpus.unwrap_or(0))
        .bind(offers.gpus)
        .bind(offers.megabytes())
        .bind(text_of_tags(&offers.tags))
        .one(self)
        .await?;
        Ok(IdlePoll { is_any_claimable, server_version })
    }
}

/// The condition that a task may be claimed, at once or after its delay. The queue must not be
/// paused, and the job's start time must have come. A delay that ends later than the longest
/// possible one was set by a clock that was set back since; it is ignored. The job's start time was
/// set by its user and always counts. `now` is the fragment of SQL.
pub(crate) fn may_be_claimed(now: &str) -> String {
    format!(
        "state = 'queued' AND (SELECT paused_at FROM queue) IS NULL AND not_before <= {now} \
         AND (run_at <= {now} OR run_at > {now} + {longest})",
        longest = milliseconds(LONGEST_DELAY)
    )
}
