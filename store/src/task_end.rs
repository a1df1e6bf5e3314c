//! The ways in which a worker gives a task back. Each is one transaction together with what
//! follows for the job, the jobs that need it and the pipelines it is in.

use std::time::Duration;

use serde_json::Value;
use sqlx::SqliteConnection;

use crate::clock::now;
use crate::database::integer;
use crate::leases::lost;
use crate::propagation::after_task;
use crate::{Fence, JobId, Store, StoreError, leases};

/// Whether a failed task may be tried again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Retry {
    /// While attempts are left.
    Allowed,
    /// It would fail again.
    Never,
}

/// What became of a task that did not succeed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    Queued,
    Failed,
    Cancelled,
}

impl Store {
    /// The task succeeded, with an optional result.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn complete(&self, fence: Fence, result: Option<&Value>) -> Result<(), StoreError> {
        const OPERATION: &str = "completing a task";
        let mut tx = self.database().write(OPERATION).await?;
        complete(&mut tx, fence, result).await?;
        tx.commit().await.map_err(StoreError::database(OPERATION))
    }

    /// The task succeeded before all that was planned was done: `done` was enough.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn complete_early(
        &self,
        fence: Fence,
        done: u64,
        result: &Value,
    ) -> Result<(), StoreError> {
        const OPERATION: &str = "completing a task early";
        let failed = StoreError::database(OPERATION);
        let mut tx = self.database().write(OPERATION).await?;
        leases::check(&mut tx, fence).await?;
        sqlx::query("UPDATE task SET total = ? WHERE id = ?")
            .bind(integer(done))
            .bind(fence.task)
            .execute(&mut *tx)
            .await
            .map_err(&failed)?;
        complete(&mut tx, fence, Some(result)).await?;
        tx.commit().await.map_err(&failed)
    }

    /// The task failed with `error`.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn fail(&self, fence: Fence, error: &str, retry: Retry) -> Result<(), StoreError> {
        const OPERATION: &str = "failing a task";
        let mut tx = self.database().write(OPERATION).await?;
        match retry {
            Retry::Allowed => {
                retry_or_fail(&mut tx, fence, error).await?;
            }
            Retry::Never => fail(&mut tx, fence, error).await?,
        }
        tx.commit().await.map_err(StoreError::database(OPERATION))
    }

    /// Puts the task back without counting the attempt, as a worker that shuts down does.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn release(&self, fence: Fence) -> Result<(), StoreError> {
        const OPERATION: &str = "releasing a task";
        let mut tx = self.database().write(OPERATION).await?;
        if attempts(&mut tx, fence).await?.cancel_requested {
            cancel(&mut tx, fence).await?;
        } else {
            sqlx::query(concat!(
                "UPDATE task SET state = 'queued', attempt = attempt - 1, run_at = ",
                now!(),
                ", lease_until = NULL, rate = NULL, message = NULL WHERE id = ?"
            ))
            .bind(fence.task)
            .execute(&mut *tx)
            .await
            .map_err(StoreError::database(OPERATION))?;
        }
        tx.commit().await.map_err(StoreError::database(OPERATION))
    }

    /// The task was stopped because its cancellation was requested.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn stopped(&self, fence: Fence) -> Result<(), StoreError> {
        const OPERATION: &str = "cancelling a task";
        let mut tx = self.database().write(OPERATION).await?;
        cancel(&mut tx, fence).await?;
        tx.commit().await.map_err(StoreError::database(OPERATION))
    }
}

pub(crate) async fn complete(
    conn: &mut SqliteConnection,
    fence: Fence,
    result: Option<&Value>,
) -> Result<(), StoreError> {
    let failed = StoreError::database("completing a task");
    let job: Option<JobId> = sqlx::query_scalar(concat!(
        "UPDATE task SET state = 'succeeded', done = total, result = ?, error = NULL, ",
        "lease_until = NULL, rate = NULL, message = NULL, finished_at = ",
        now!(),
        " WHERE id = ? AND epoch = ? AND state = 'running' RETURNING job"
    ))
    .bind(result.map(Value::to_string))
    .bind(fence.task)
    .bind(fence.epoch)
    .fetch_optional(&mut *conn)
    .await
    .map_err(&failed)?;
    after_task(conn, job.ok_or_else(|| lost(fence))?).await.map_err(&failed)
}

/// Queues the task again while attempts are left, later each time.
pub(crate) async fn retry_or_fail(
    conn: &mut SqliteConnection,
    fence: Fence,
    error: &str,
) -> Result<Ending, StoreError> {
    let Attempts { attempt, max_attempts, cancel_requested } = attempts(conn, fence).await?;
    if cancel_requested {
        cancel(conn, fence).await?;
        return Ok(Ending::Cancelled);
    }
    let error = format!("{error} (attempt {attempt} of {max_attempts})");
    if attempt >= max_attempts {
        fail(conn, fence, &error).await?;
        return Ok(Ending::Failed);
    }
    let delay = i64::try_from(delay_after(attempt).as_millis()).unwrap_or(0);
    sqlx::query(concat!(
        "UPDATE task SET state = 'queued', error = ?, lease_until = NULL, rate = NULL, \
          message = NULL, run_at = ",
        now!(),
        " + ? WHERE id = ?"
    ))
    .bind(error)
    .bind(delay)
    .bind(fence.task)
    .execute(conn)
    .await
    .map_err(StoreError::database("queueing a task again"))?;
    Ok(Ending::Queued)
}

async fn fail(conn: &mut SqliteConnection, fence: Fence, error: &str) -> Result<(), StoreError> {
    end(conn, fence, "failed", Some(error)).await
}

async fn cancel(conn: &mut SqliteConnection, fence: Fence) -> Result<(), StoreError> {
    end(conn, fence, "cancelled", None).await
}

async fn end(
    conn: &mut SqliteConnection,
    fence: Fence,
    state: &str,
    error: Option<&str>,
) -> Result<(), StoreError> {
    let failed = StoreError::database("ending a task");
    let job = leases::check(conn, fence).await?;
    sqlx::query(concat!(
        "UPDATE task SET state = ?, error = COALESCE(?, error), lease_until = NULL, rate = NULL, \
          message = NULL, finished_at = ",
        now!(),
        " WHERE id = ?"
    ))
    .bind(state)
    .bind(error)
    .bind(fence.task)
    .execute(&mut *conn)
    .await
    .map_err(&failed)?;
    after_task(conn, job).await.map_err(&failed)
}

#[derive(sqlx::FromRow)]
struct Attempts {
    attempt: u32,
    max_attempts: u32,
    cancel_requested: bool,
}

async fn attempts(conn: &mut SqliteConnection, fence: Fence) -> Result<Attempts, StoreError> {
    sqlx::query_as(
        "SELECT attempt, max_attempts, cancel_requested FROM task \
         WHERE id = ? AND epoch = ? AND state = 'running'",
    )
    .bind(fence.task)
    .bind(fence.epoch)
    .fetch_optional(conn)
    .await
    .map_err(StoreError::database("checking a lease"))?
    .ok_or_else(|| lost(fence))
}

const FIRST_DELAY: Duration = Duration::from_secs(5);
const LONGEST_DELAY: Duration = Duration::from_secs(300);

/// At once after the first attempt, since most deaths have nothing to do with the task; then
/// twice as long each time.
fn delay_after(attempt: u32) -> Duration {
    let Some(doublings) = attempt.checked_sub(2) else { return Duration::ZERO };
    FIRST_DELAY.saturating_mul(2u32.saturating_pow(doublings)).min(LONGEST_DELAY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn retries_come_at_once_and_then_ever_later_up_to_a_limit() {
        let seconds: Vec<u64> = (1..=5).map(|attempt| delay_after(attempt).as_secs()).collect();
        assert_eq!(seconds, [0, 5, 10, 20, 40]);
        assert_eq!(delay_after(20), LONGEST_DELAY);
    }
}
