//! Claiming and completing a task in one round trip each.
//!
//! Both need a lock before they read, or they could miss a pause of the queue or the end of a stage.
//! So one message carries the lock and the statement. PostgreSQL executes a message as one
//! transaction, and each of its statements sees everything that was committed before that statement
//! began. Such a message has no parameters and would be planned each time, so each connection
//! prepares both statements when it first needs one.
//!
//! A claim passes over tasks that others are claiming. If it begins a job, the job shows this after
//! a second transaction, which waits for the queue's lock.

use std::time::Duration;

use serde_json::Value;
use spec::Resources;
use sqlx::postgres::PgRow;
use sqlx::{AssertSqlSafe, Row};
use wire::{AttemptOutcome, TaskState};

use super::dialect::{NOW, first_in_line};
use super::{Database, LEASE_LOCK, QUEUE_LOCK};
use crate::database::StageEnd;
use crate::database::column::milliseconds;
use crate::database::query::{FromRow as _, Row as FoundRow};
use crate::database::rows::text_of_tags;
use crate::queue::statements::tasks::NextTask;
use crate::{Fence, StoreError};

/// PostgreSQL's code for a prepared statement that the connection does not have.
/// <https://www.postgresql.org/docs/15/errcodes-appendix.html>
const NOT_PREPARED: &str = "26000";

/// The SQL that prepares both statements.
fn prepared() -> String {
    format!("{}; {}", prepared_claim(), prepared_completion())
}

/// Follows `TaskStanding::claimed`. PostgreSQL returns the newest version of a locked row.
fn prepared_claim() -> String {
    format!(
        "PREPARE torqued_claim (TEXT, BIGINT, BIGINT, BIGINT, TEXT, BIGINT) AS \
         WITH next AS MATERIALIZED ({next}), \
         leased AS (UPDATE task SET state = '{running}', attempt = next.attempt + 1, \
             epoch = next.epoch + 1, worker = $1, lease_until = {now} + $6, lease_ms = $6, \
             started_at = COALESCE(task.started_at, {now}), done = 0, rate = NULL, message = NULL \
             FROM next WHERE task.id = next.id), \
         begun AS (INSERT INTO attempt (job, task, epoch, worker, started_at) \
             SELECT job, id, epoch + 1, $1, {now} FROM next) \
         SELECT next.*, job.kind, job.spec, job.digest, job.time_limit_s, job.state AS job_state, \
             run.id AS run \
         FROM next JOIN job ON job.id = next.job LEFT JOIN run ON run.job = job.id",
        next = first_in_line(" FOR NO KEY UPDATE SKIP LOCKED"),
        running = TaskState::Running.as_str(),
        now = NOW,
    )
}

fn prepared_completion() -> String {
    format!(
        "PREPARE torqued_completion (BIGINT, BIGINT, TEXT) AS \
         WITH held AS MATERIALIZED (SELECT id, EXISTS (SELECT 1 FROM task AS other \
                 WHERE other.job = task.job AND other.state = '{queued}' AND other.stage = task.stage) \
                 AS goes_on \
             FROM task WHERE id = $1 AND state = '{running}' AND epoch = $2 FOR NO KEY UPDATE), \
         ended AS (UPDATE task SET state = '{succeeded}', done = total, result = $3, error = NULL, \
             lease_until = NULL, rate = NULL, message = NULL, finished_at = {now} \
             FROM held WHERE task.id = held.id AND held.goes_on), \
         attempt_ended AS (UPDATE attempt SET outcome = '{outcome}', reason = NULL, ended_at = {now} \
             FROM held WHERE attempt.task = held.id AND attempt.epoch = $2 AND held.goes_on) \
         SELECT goes_on FROM held",
        queued = TaskState::Queued.as_str(),
        running = TaskState::Running.as_str(),
        succeeded = TaskState::Succeeded.as_str(),
        outcome = AttemptOutcome::Succeeded.as_str(),
        now = NOW,
    )
}

impl Database {
    /// Leases the next task to `worker` and returns it as it was before.
    pub async fn claim(
        &self,
        worker: &str,
        offers: &Resources,
        ttl: Duration,
        operation: &'static str,
    ) -> Result<Option<NextTask>, StoreError> {
        let sent = format!(
            "SELECT pg_advisory_xact_lock_shared({LEASE_LOCK}); \
             EXECUTE torqued_claim ({worker}, {cpus}, {gpus}, {memory_mb}, {tags}, {ttl})",
            worker = literal(worker),
            cpus = offers.cpus.unwrap_or(0),
            gpus = offers.gpus,
            memory_mb = offers.megabytes(),
            tags = literal(&text_of_tags(&offers.tags)),
            ttl = milliseconds(ttl),
        );
        let rows = self.locked_rows(sent).await.map_err(StoreError::database(operation))?;
        let row = rows.into_iter().next().map(|row| FoundRow::new(row, operation));
        row.as_ref().map(NextTask::from_row).transpose()
    }

    /// Completes a held task, and the attempt, if another task of its stage is queued.
    pub async fn complete_in_stage(
        &self,
        fence: Fence,
        result: Option<&Value>,
    ) -> Result<StageEnd, sqlx::Error> {
        let sent = format!(
            "SELECT pg_advisory_xact_lock_shared({QUEUE_LOCK}); \
             EXECUTE torqued_completion ({task}, {epoch}, {result})",
            task = fence.task.0,
            epoch = fence.epoch.0,
            result =
                result.map_or_else(|| "NULL".to_owned(), |result| literal(&result.to_string())),
        );
        let rows = self.locked_rows(sent).await?;
        let Some(row) = rows.first() else { return Ok(StageEnd::Lost) };
        let goes_on: bool = row.try_get("goes_on")?;
        Ok(if goes_on { StageEnd::Completed } else { StageEnd::Last })
    }

    /// The rows of a statement that follows a lock. The lock answers the first row.
    async fn locked_rows(&self, sent: String) -> Result<Vec<PgRow>, sqlx::Error> {
        let mut connection = self.lend().await?;
        let sent = || sqlx::raw_sql(AssertSqlSafe(sent.clone()));
        let mut rows = match sent().fetch_all(&mut *connection).await {
            Err(error) if is_not_prepared(&error) => {
                sqlx::raw_sql(AssertSqlSafe(prepared())).execute(&mut *connection).await?;
                sent().fetch_all(&mut *connection).await?
            }
            rows => rows?,
        };
        self.take_back(connection);
        Ok(rows.split_off(1.min(rows.len())))
    }
}

fn is_not_prepared(error: &sqlx::Error) -> bool {
    let code = error.as_database_error().and_then(|error| error.code());
    code.as_deref() == Some(NOT_PREPARED)
}

/// A text as SQL, safe for any content and for any setting of `standard_conforming_strings`.
fn literal(text: &str) -> String {
    format!("convert_from(decode('{}', 'hex'), 'UTF8')", hex::encode(text))
}
