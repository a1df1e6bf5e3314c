//! Leases: how a worker gets a task, keeps it, and loses it.
//!
//! A claim raises the task's epoch. Whatever the worker writes afterwards names that epoch and
//! changes nothing once it has passed, so a worker that was thought dead cannot do harm.

use std::time::Duration;

use serde_json::Value;
use spec::Digest;
use sqlx::sqlite::SqliteRow;
use sqlx::{FromRow, Row, SqliteConnection};

use crate::clock::now;
use crate::database::integer;
use crate::task_end::{self, Ending};
use crate::{Epoch, JobId, RunId, Store, StoreError, TaskId, jobs, pipelines};

/// A task and the epoch at which it was claimed: what gives a write its right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Fence {
    pub task: TaskId,
    pub epoch: Epoch,
}

#[derive(Clone, Debug)]
pub struct ClaimedTask {
    pub fence: Fence,
    pub job: JobId,
    /// The job's, opaque to the store.
    pub kind: String,
    /// The job's, resolved.
    pub spec: Value,
    /// The job's.
    pub digest: Digest,
    /// The job's record, if it leaves one.
    pub run: Option<RunId>,
    pub stage: u32,
    pub ordinal: u32,
    pub label: String,
    pub payload: Value,
    pub total: u64,
    /// 1 at the first claim.
    pub attempt: u32,
    pub max_attempts: u32,
}

/// What a worker tells of a running task.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// In the job's unit, of the task's `total`.
    pub done: u64,
    pub rate_per_second: Option<f64>,
    pub message: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lease {
    Held {
        cancel_requested: bool,
    },
    /// Somebody else may have the task: stop.
    Lost,
}

/// What became of the tasks whose leases had run out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reaped {
    pub queued: u32,
    pub failed: u32,
    pub cancelled: u32,
}

impl Store {
    /// Leases the next task to `worker` for `ttl`; the attempt counts from here on.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn claim(
        &self,
        worker: &str,
        ttl: Duration,
    ) -> Result<Option<ClaimedTask>, StoreError> {
        const OPERATION: &str = "claiming a task";
        let failed = StoreError::database(OPERATION);
        // Idle workers ask often; they should not queue for the write lock to learn nothing.
        let claimable: bool = sqlx::query_scalar(concat!(
            "SELECT EXISTS (SELECT 1 FROM task WHERE state = 'queued' AND run_at <= ",
            now!(),
            ")"
        ))
        .fetch_one(self.database().reader())
        .await
        .map_err(&failed)?;
        if !claimable {
            return Ok(None);
        }
        let mut tx = self.database().write(OPERATION).await?;
        let claimed = claim(&mut tx, worker, ttl).await.map_err(&failed)?;
        tx.commit().await.map_err(&failed)?;
        Ok(claimed)
    }

    /// Prolongs a lease to `ttl` from now and records progress.
    ///
    /// # Errors
    /// When the database fails; a lost lease is an answer, not an error.
    pub async fn renew(
        &self,
        fence: Fence,
        ttl: Duration,
        progress: &Progress,
    ) -> Result<Lease, StoreError> {
        const OPERATION: &str = "renewing a lease";
        let failed = StoreError::database(OPERATION);
        let mut tx = self.database().write(OPERATION).await?;
        let cancel_requested: Option<bool> = sqlx::query_scalar(concat!(
            "UPDATE task SET lease_until = ",
            now!(),
            " + ?, done = ?, rate = ?, message = ? \
              WHERE id = ? AND epoch = ? AND state = 'running' RETURNING cancel_requested"
        ))
        .bind(milliseconds(ttl))
        .bind(integer(progress.done))
        .bind(progress.rate_per_second)
        .bind(&progress.message)
        .bind(fence.task)
        .bind(fence.epoch)
        .fetch_optional(&mut *tx)
        .await
        .map_err(&failed)?;
        tx.commit().await.map_err(&failed)?;
        Ok(cancel_requested
            .map_or(Lease::Lost, |cancel_requested| Lease::Held { cancel_requested }))
    }

    /// Takes back the tasks of workers that stopped renewing.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn reap(&self) -> Result<Reaped, StoreError> {
        const OPERATION: &str = "reaping expired leases";
        const EXPIRED: &str = concat!(
            "SELECT id, epoch, worker FROM task WHERE state = 'running' AND lease_until < ",
            now!(),
            " ORDER BY id"
        );
        let failed = StoreError::database(OPERATION);
        let none = sqlx::query(EXPIRED)
            .fetch_optional(self.database().reader())
            .await
            .map_err(&failed)?
            .is_none();
        let mut reaped = Reaped::default();
        if none {
            return Ok(reaped);
        }
        let mut tx = self.database().write(OPERATION).await?;
        let expired: Vec<(TaskId, Epoch, Option<String>)> =
            sqlx::query_as(EXPIRED).fetch_all(&mut *tx).await.map_err(&failed)?;
        for (task, epoch, worker) in expired {
            let worker = worker.unwrap_or_default();
            let error = format!("worker {worker} stopped answering");
            match task_end::retry_or_fail(&mut tx, Fence { task, epoch }, &error).await? {
                Ending::Queued => reaped.queued += 1,
                Ending::Failed => reaped.failed += 1,
                Ending::Cancelled => reaped.cancelled += 1,
            }
        }
        tx.commit().await.map_err(&failed)?;
        Ok(reaped)
    }
}

async fn claim(
    conn: &mut SqliteConnection,
    worker: &str,
    ttl: Duration,
) -> Result<Option<ClaimedTask>, sqlx::Error> {
    let task: Option<TaskId> = sqlx::query_scalar(concat!(
        "UPDATE task SET state = 'running', attempt = attempt + 1, epoch = epoch + 1, \
          worker = ?, lease_until = ",
        now!(),
        " + ?, started_at = COALESCE(started_at, ",
        now!(),
        "), done = 0, rate = NULL, message = NULL WHERE id = (SELECT id FROM task \
          WHERE state = 'queued' AND run_at <= ",
        now!(),
        " ORDER BY priority DESC, run_at, id LIMIT 1) RETURNING id"
    ))
    .bind(worker)
    .bind(milliseconds(ttl))
    .fetch_optional(&mut *conn)
    .await?;
    let Some(task) = task else { return Ok(None) };
    let claimed: ClaimedTask = sqlx::query_as(
        "SELECT task.*, job.kind, job.spec, job.digest, run.id AS run FROM task \
         JOIN job ON job.id = task.job LEFT JOIN run ON run.job = job.id WHERE task.id = ?",
    )
    .bind(task)
    .fetch_one(&mut *conn)
    .await?;
    let started = sqlx::query(concat!(
        "UPDATE job SET state = 'running', started_at = ",
        now!(),
        " WHERE id = ? AND state = 'queued'"
    ))
    .bind(claimed.job)
    .execute(&mut *conn)
    .await?;
    if started.rows_affected() > 0 {
        pipelines::settle_those_of(conn, claimed.job).await?;
    }
    Ok(Some(claimed))
}

/// The job of a leased task.
///
/// # Errors
/// [`StoreError::LeaseLost`] unless the task is running at the fence's epoch. Valid until the
/// transaction ends, since it holds the write lock.
pub(crate) async fn check(conn: &mut SqliteConnection, fence: Fence) -> Result<JobId, StoreError> {
    sqlx::query_scalar("SELECT job FROM task WHERE id = ? AND epoch = ? AND state = 'running'")
        .bind(fence.task)
        .bind(fence.epoch)
        .fetch_optional(conn)
        .await
        .map_err(StoreError::database("checking a lease"))?
        .ok_or_else(|| lost(fence))
}

/// The run of a leased task's job.
pub(crate) async fn check_run(
    conn: &mut SqliteConnection,
    fence: Fence,
) -> Result<RunId, StoreError> {
    let job = check(conn, fence).await?;
    sqlx::query_scalar("SELECT id FROM run WHERE job = ?")
        .bind(job)
        .fetch_optional(conn)
        .await
        .map_err(StoreError::database("looking up a run"))?
        .ok_or_else(|| StoreError::not_found("run of job", job.to_string()))
}

pub(crate) fn lost(fence: Fence) -> StoreError {
    StoreError::LeaseLost { task: fence.task, epoch: fence.epoch }
}

fn milliseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX / 2)
}

impl FromRow<'_, SqliteRow> for ClaimedTask {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            fence: Fence { task: row.try_get("id")?, epoch: row.try_get("epoch")? },
            job: row.try_get("job")?,
            kind: row.try_get("kind")?,
            spec: jobs::json(row, "spec")?,
            digest: jobs::digest(row, "digest")?,
            run: row.try_get("run")?,
            stage: row.try_get("stage")?,
            ordinal: row.try_get("ordinal")?,
            label: row.try_get("label")?,
            payload: jobs::json(row, "payload")?,
            total: row.try_get("total")?,
            attempt: row.try_get("attempt")?,
            max_attempts: row.try_get("max_attempts")?,
        })
    }
}
