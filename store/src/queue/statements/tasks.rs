use std::time::Duration;

use serde_json::Value;
use sqlx::types::Text;
use sqlx::{FromRow, Row};
use wire::AttemptOutcome;

use super::rows::{digest, json, number, optional_number, state};
use super::{Database, DbRow, Transaction, integer, milliseconds};
use crate::queue::leases::NextTask;
use crate::queue::rules::job::TaskTally;
use crate::queue::rules::task::TaskStanding;
use crate::queue::rules::watch::Leased;
use crate::{ClaimedTask, Epoch, Fence, JobId, Progress, Task, TaskId, Timestamp};

/// The duration of leases in rows of a version that did not record it.
const USUAL_LEASE_MS: i64 = 15_000;

impl Database {
    /// In the order in which they run.
    pub async fn tasks(&self, job: JobId) -> Result<Vec<Task>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM task WHERE job = $1 ORDER BY stage, ordinal")
            .bind(job)
            .fetch_all(&self.reader)
            .await
    }

    pub async fn task(&self, id: TaskId) -> Result<Option<Task>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM task WHERE id = $1")
            .bind(id)
            .fetch_optional(&self.reader)
            .await
    }

    /// The leases of all running tasks.
    pub async fn leased(&self) -> Result<Vec<Leased>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT id, epoch, worker, lease_until, lease_ms, lease_until < ",
            now!(),
            " AS has_passed FROM task WHERE state = 'running'"
        ))
        .fetch_all(&self.reader)
        .await
    }
}

impl Transaction {
    /// The job and the state of a task. The row is locked until the transaction ends, because every
    /// write of a worker depends on the answer.
    pub async fn standing(
        &mut self,
        task: TaskId,
    ) -> Result<Option<(JobId, TaskStanding)>, sqlx::Error> {
        let row = sqlx::query(concat!(
            "SELECT job, state, attempt, max_attempts, epoch, cancel_requested FROM task \
             WHERE id = $1",
            locked!()
        ))
        .bind(task)
        .fetch_optional(self.connection())
        .await?;
        row.map(|row| Ok((row.try_get("job")?, TaskStanding::from_row(&row)?))).transpose()
    }

    /// Like [`Self::standing`], and tells whether another task of the same stage is queued.
    pub async fn standing_in_stage(
        &mut self,
        task: TaskId,
    ) -> Result<Option<(JobId, TaskStanding, bool)>, sqlx::Error> {
        let row = sqlx::query(concat!(
            "SELECT job, state, attempt, max_attempts, epoch, cancel_requested, \
             EXISTS (SELECT 1 FROM task AS other WHERE other.job = task.job \
                     AND other.state = 'queued' AND other.stage = task.stage) AS goes_on \
             FROM task WHERE id = $1",
            locked!()
        ))
        .bind(task)
        .fetch_optional(self.connection())
        .await?;
        let read = |row: DbRow| {
            Ok((row.try_get("job")?, TaskStanding::from_row(&row)?, row.try_get("goes_on")?))
        };
        row.map(read).transpose()
    }

    pub async fn renew(
        &mut self,
        task: TaskId,
        ttl: Duration,
        progress: &Progress,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE task SET lease_until = ",
            now!(),
            " + $1, lease_ms = $1, done = $2, rate = $3, message = $4 WHERE id = $5"
        ))
        .bind(milliseconds(ttl))
        .bind(integer(progress.done))
        .bind(progress.rate_per_second)
        .bind(&progress.message)
        .bind(task);
        self.execute(statement).await
    }

    /// The end of a running task's lease. The row is locked until the transaction ends.
    pub async fn lease_until(&mut self, task: TaskId) -> Result<Option<Timestamp>, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "SELECT lease_until FROM task WHERE id = $1 AND state = 'running'",
            locked!()
        ))
        .bind(task)
        .fetch_optional(self.connection())
        .await
    }

    /// The running tasks of a worker.
    pub async fn leased_by(&mut self, worker: &str) -> Result<Vec<Fence>, sqlx::Error> {
        let rows: Vec<(TaskId, Epoch)> =
            sqlx::query_as("SELECT id, epoch FROM task WHERE state = 'running' AND worker = $1")
                .bind(worker)
                .fetch_all(self.connection())
                .await?;
        Ok(rows.into_iter().map(|(task, epoch)| Fence { task, epoch }).collect())
    }

    pub async fn set_attempt(&mut self, task: TaskId, attempt: u32) -> Result<(), sqlx::Error> {
        let statement = sqlx::query("UPDATE task SET attempt = $1 WHERE id = $2")
            .bind(i64::from(attempt))
            .bind(task);
        self.execute(statement).await
    }

    pub async fn set_total(&mut self, task: TaskId, total: u64) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query("UPDATE task SET total = $1 WHERE id = $2").bind(integer(total)).bind(task);
        self.execute(statement).await
    }

    /// Ends a task that succeeded, and its attempt. Removes the task's error.
    pub async fn complete_task(
        &mut self,
        task: TaskId,
        standing: &TaskStanding,
        result: Option<&Value>,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(together!(
            concat!(
                "UPDATE task SET state = $1, done = total, result = $2, error = NULL, \
                  lease_until = NULL, rate = NULL, message = NULL, finished_at = ",
                now!(),
                " WHERE id = $3"
            ),
            concat!(
                "UPDATE attempt SET outcome = $4, reason = NULL, ended_at = ",
                now!(),
                " WHERE task = $3 AND epoch = $5"
            )
        ))
        .bind(standing.state.as_str())
        .bind(result.map(Value::to_string))
        .bind(task)
        .bind(AttemptOutcome::Succeeded.as_str())
        .bind(standing.epoch);
        self.execute(statement).await
    }

    /// Ends a task. Without an `error` it keeps that of the last attempt.
    pub async fn end_task(
        &mut self,
        task: TaskId,
        standing: &TaskStanding,
        error: Option<&str>,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE task SET state = $1, error = COALESCE($2, error), lease_until = NULL, \
              rate = NULL, message = NULL, finished_at = ",
            now!(),
            " WHERE id = $3"
        ))
        .bind(standing.state.as_str())
        .bind(error)
        .bind(task);
        self.execute(statement).await
    }

    /// Queues a task again. It cannot be claimed before `delay` has passed, less a random part of
    /// up to a quarter, so tasks that failed together do not come back together. Without a delay it
    /// can be claimed at once.
    pub async fn requeue_task(
        &mut self,
        task: TaskId,
        standing: &TaskStanding,
        delay: Duration,
        error: Option<&str>,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "UPDATE task SET state = $1, attempt = $2, error = COALESCE($3, error), \
              lease_until = NULL, rate = NULL, message = NULL, \
              run_at = CASE WHEN $4 = 0 THEN 0 \
                            ELSE $4 * (750 + ",
            chance!(),
            ") / 1000 + ",
            now!(),
            " END WHERE id = $5"
        ))
        .bind(standing.state.as_str())
        .bind(i64::from(standing.attempt))
        .bind(error)
        .bind(milliseconds(delay))
        .bind(task);
        self.execute(statement).await?;
        self.ring().await
    }

    /// Counts a job's tasks. Each part reads the first entry of an index, however many tasks the
    /// job has.
    pub async fn tally(&mut self, job: JobId) -> Result<TaskTally, sqlx::Error> {
        let row = sqlx::query(
            "SELECT EXISTS (SELECT 1 FROM task WHERE job = $1 AND state = 'failed') AS failed, \
             EXISTS (SELECT 1 FROM task WHERE job = $1 AND state = 'cancelled') AS cancelled, \
             (SELECT MIN(stage) FROM task WHERE job = $1 AND state = 'waiting') AS waiting, \
             (SELECT MIN(stage) FROM task WHERE job = $1 AND state = 'queued') AS queued, \
             (SELECT MIN(stage) FROM task WHERE job = $1 AND state = 'running') AS running",
        )
        .bind(job)
        .fetch_one(self.connection())
        .await?;
        let waiting_stage: Option<u32> = optional_number(&row, "waiting")?;
        let claimable: Option<u32> = optional_number(&row, "queued")?;
        let claimed: Option<u32> = optional_number(&row, "running")?;
        Ok(TaskTally {
            failed: row.try_get("failed")?,
            cancelled: row.try_get("cancelled")?,
            open_stage: [waiting_stage, claimable, claimed].into_iter().flatten().min(),
            waiting_stage,
        })
    }

    /// The error of the first task of a job that failed.
    pub async fn first_failure(&mut self, job: JobId) -> Result<Option<String>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT label || ': ' || COALESCE(error, 'failed') FROM task \
             WHERE job = $1 AND state = 'failed' ORDER BY id LIMIT 1",
        )
        .bind(job)
        .fetch_optional(self.connection())
        .await
    }

    /// Queues the waiting tasks of a stage, all at once.
    pub async fn queue_stage(&mut self, job: JobId, stage: u32) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "UPDATE task SET state = 'queued', run_at = 0 \
             WHERE job = $1 AND stage = $2 AND state = 'waiting'",
        )
        .bind(job)
        .bind(i64::from(stage));
        self.execute(statement).await?;
        self.ring().await
    }

    /// Cancels queued tasks, and requests the cancellation of running tasks. The tests of `rules`
    /// check this against a model.
    pub async fn stop_tasks(&mut self, job: JobId) -> Result<(), sqlx::Error> {
        sqlx::query(concat!(
            "UPDATE task SET state = 'cancelled', finished_at = ",
            now!(),
            " WHERE job = $1 AND state IN ('waiting', 'queued')"
        ))
        .bind(job)
        .execute(self.connection())
        .await?;
        sqlx::query("UPDATE task SET cancel_requested = TRUE WHERE job = $1 AND state = 'running'")
            .bind(job)
            .execute(self.connection())
            .await?;
        Ok(())
    }
}

impl FromRow<'_, DbRow> for TaskStanding {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            state: state(row)?,
            attempt: number(row, "attempt")?,
            max_attempts: number(row, "max_attempts")?,
            epoch: row.try_get("epoch")?,
            cancel_requested: row.try_get("cancel_requested")?,
        })
    }
}

impl FromRow<'_, DbRow> for Leased {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let lasts: Option<i64> = row.try_get("lease_ms")?;
        let worker: Option<String> = row.try_get("worker")?;
        Ok(Self {
            fence: Fence { task: row.try_get("id")?, epoch: row.try_get("epoch")? },
            worker: worker.unwrap_or_default(),
            until: row.try_get("lease_until")?,
            lasts: Duration::from_millis(lasts.unwrap_or(USUAL_LEASE_MS).unsigned_abs()),
            has_passed: row.try_get("has_passed")?,
        })
    }
}

impl FromRow<'_, DbRow> for NextTask {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let Text(job_state) = row.try_get("job_state")?;
        let standing = TaskStanding::from_row(row)?;
        Ok(Self { task: ClaimedTask::from_row(row)?, standing, job_state })
    }
}

impl FromRow<'_, DbRow> for ClaimedTask {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let time_limit: Option<u32> = optional_number(row, "time_limit_s")?;
        Ok(Self {
            fence: Fence { task: row.try_get("id")?, epoch: row.try_get("epoch")? },
            job: row.try_get("job")?,
            kind: row.try_get("kind")?,
            spec: json(row, "spec")?,
            digest: digest(row, "digest")?,
            run: row.try_get("run")?,
            stage: number(row, "stage")?,
            ordinal: number(row, "ordinal")?,
            label: row.try_get("label")?,
            payload: json(row, "payload")?,
            total: number(row, "total")?,
            attempt: number(row, "attempt")?,
            max_attempts: number(row, "max_attempts")?,
            time_limit: time_limit.map(|seconds| Duration::from_secs(u64::from(seconds))),
        })
    }
}

impl FromRow<'_, DbRow> for Task {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let result: Option<&str> = row.try_get("result")?;
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            stage: number(row, "stage")?,
            ordinal: number(row, "ordinal")?,
            label: row.try_get("label")?,
            payload: json(row, "payload")?,
            state: state(row)?,
            attempt: number(row, "attempt")?,
            max_attempts: number(row, "max_attempts")?,
            epoch: row.try_get("epoch")?,
            worker: row.try_get("worker")?,
            lease_until: row.try_get("lease_until")?,
            cancel_requested: row.try_get("cancel_requested")?,
            progress: Progress {
                done: number(row, "done")?,
                rate_per_second: row.try_get("rate")?,
                message: row.try_get("message")?,
            },
            total: number(row, "total")?,
            result: result.map(|_| json(row, "result")).transpose()?,
            error: row.try_get("error")?,
            started_at: row.try_get("started_at")?,
            finished_at: row.try_get("finished_at")?,
        })
    }
}
