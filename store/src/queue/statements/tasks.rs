//! Tasks and their leases, as rows.

use std::time::Duration;

use serde_json::Value;
use spec::Digest;
use wire::{AttemptOutcome, JobState, TaskState};

use crate::database::query::{FromRow, Row, from_row, sql};
use crate::database::{Reading, Transaction};
use crate::queue::rules::job::TaskTally;
use crate::queue::rules::task::TaskStanding;
use crate::queue::rules::watch::Leased;
use crate::{Epoch, Fence, JobId, RunId, StoreError, TaskId, Timestamp};

/// The duration of leases in rows of a version that did not record it.
const USUAL_LEASE_MS: i64 = 15_000;

/// A task that a worker has just leased, with what the worker needs to know of its job.
#[derive(Clone, Debug)]
pub struct ClaimedTask {
    /// The proof of the lease, which each write of the worker carries.
    pub fence: Fence,
    /// The job that the task belongs to.
    pub job: JobId,
    /// The job's kind. The store does not interpret it.
    pub kind: String,
    /// The job's resolved spec.
    pub spec: Value,
    /// The job's digest.
    pub digest: Digest,
    /// The job's run, if it leaves one.
    pub run: Option<RunId>,
    /// The stage of the task. Tasks of later stages wait for it.
    pub stage: u32,
    /// The place of the task in its stage.
    pub ordinal: u32,
    /// A name for people, such as `shard 3`.
    pub label: String,
    /// The part of the job that the task is, for the job's kind.
    pub payload: Value,
    /// Amount of work, in the job's unit.
    pub total: u64,
    /// 1 at the first claim, and at the first claim after a checkpoint of a later step.
    pub attempt: u32,
    /// Number of claims after which a failure is final.
    pub max_attempts: u32,
    /// Time limit of an attempt.
    pub time_limit: Option<Duration>,
}

/// The next task to be claimed, in its state before the claim.
#[derive(Clone, Debug)]
pub(crate) struct NextTask {
    pub task: ClaimedTask,
    pub standing: TaskStanding,
    pub job_state: JobState,
}

/// Progress of a running task, as its worker reports it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Work done in the job's unit, out of the task's `total`.
    pub done: u64,
    /// Work per second, in the job's unit.
    pub rate_per_second: Option<f64>,
    /// What the worker is doing, for people.
    pub message: Option<String>,
}

/// The result of an idle worker's poll for a task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdlePoll {
    /// Whether there is a task that the worker could claim.
    pub is_any_claimable: bool,
    /// The version of the server that was started last; `None` before the first.
    pub server_version: Option<String>,
}

/// A task as it is now.
#[derive(Clone, Debug)]
pub struct Task {
    /// Its id.
    pub id: TaskId,
    /// The job that it belongs to.
    pub job: JobId,
    /// Its stage. Tasks of later stages wait for it.
    pub stage: u32,
    /// Its place in its stage.
    pub ordinal: u32,
    /// A name for people, such as `shard 3`.
    pub label: String,
    /// The part of the job that it is, for the job's kind.
    pub payload: Value,
    /// Where it stands between its submission and its end.
    pub state: TaskState,
    /// Number of claims since it last made progress, see [`Store::commit_checkpoint`].
    pub attempt: u32,
    /// Number of claims after which a failure is final.
    pub max_attempts: u32,
    /// The number of its newest lease: one more at every claim.
    pub epoch: Epoch,
    /// The worker that has it, or had it last.
    pub worker: Option<String>,
    /// When its lease ends, unless it is renewed before.
    pub lease_until: Option<Timestamp>,
    /// Whether its worker should stop it.
    pub cancel_requested: bool,
    /// How much of its work is done.
    pub progress: Progress,
    /// Amount of work in the job's unit.
    pub total: u64,
    /// The result with which it was completed.
    pub result: Option<Value>,
    /// The error of the last attempt that failed.
    pub error: Option<String>,
    /// When a worker first claimed it.
    pub started_at: Option<Timestamp>,
    /// When it reached a final state.
    pub finished_at: Option<Timestamp>,
}

impl NextTask {
    /// Whether it is the first task of its job to be claimed.
    pub fn begins_its_job(&self) -> bool {
        self.job_state == JobState::Queued
    }

    /// The task as it is after the claim.
    pub fn claimed(self) -> ClaimedTask {
        let TaskStanding { attempt, epoch, .. } = self.standing.claimed();
        let fence = Fence { epoch, ..self.task.fence };
        ClaimedTask { fence, attempt, ..self.task }
    }
}

impl Reading<'_> {
    /// In the order in which they run.
    pub async fn tasks(&mut self, job: JobId) -> Result<Vec<Task>, StoreError> {
        sql("SELECT * FROM task WHERE job = $1 ORDER BY stage, ordinal").bind(job).all(self).await
    }

    pub async fn task(&mut self, id: TaskId) -> Result<Option<Task>, StoreError> {
        sql("SELECT * FROM task WHERE id = $1").bind(id).optional(self).await
    }

    /// The leases of all running tasks.
    pub async fn leased(&mut self) -> Result<Vec<Leased>, StoreError> {
        sql("SELECT id, epoch, worker, lease_until, lease_ms, lease_until < {now} AS has_passed \
             FROM task WHERE state = 'running'")
        .all(self)
        .await
    }
}

impl Transaction {
    /// The job and the state of a task. The row is locked until the transaction ends, because every
    /// write of a worker depends on the answer.
    pub async fn standing(
        &mut self,
        task: TaskId,
    ) -> Result<Option<(JobId, TaskStanding)>, StoreError> {
        let row =
            sql("SELECT job, state, attempt, max_attempts, epoch, cancel_requested FROM task \
             WHERE id = $1{locked}")
            .bind(task)
            .optional_row(self)
            .await?;
        row.map(|row| Ok((row.get("job")?, TaskStanding::from_row(&row)?))).transpose()
    }

    /// Like [`Self::standing`], and tells whether another task of the same stage is queued.
    pub async fn standing_in_stage(
        &mut self,
        task: TaskId,
    ) -> Result<Option<(JobId, TaskStanding, bool)>, StoreError> {
        let row = sql(
            "SELECT job, state, attempt, max_attempts, epoch, cancel_requested, EXISTS (SELECT 1 \
             FROM task AS other WHERE other.job = task.job AND other.state = 'queued' \
             AND other.stage = task.stage) AS goes_on FROM task WHERE id = $1{locked}",
        )
        .bind(task)
        .optional_row(self)
        .await?;
        let read =
            |row: Row| Ok((row.get("job")?, TaskStanding::from_row(&row)?, row.get("goes_on")?));
        row.map(read).transpose()
    }

    pub async fn renew(
        &mut self,
        task: TaskId,
        ttl: Duration,
        progress: &Progress,
    ) -> Result<(), StoreError> {
        sql("UPDATE task SET lease_until = {now} + $1, lease_ms = $1, done = $2, rate = $3, \
             message = $4 WHERE id = $5")
        .bind(ttl)
        .bind(progress.done)
        .bind(progress.rate_per_second)
        .bind(&progress.message)
        .bind(task)
        .run(self)
        .await
    }

    /// The end of a running task's lease. The row is locked until the transaction ends.
    pub async fn lease_until(&mut self, task: TaskId) -> Result<Option<Timestamp>, StoreError> {
        sql("SELECT lease_until FROM task WHERE id = $1 AND state = 'running'{locked}")
            .bind(task)
            .optional(self)
            .await
    }

    /// The running tasks of a worker.
    pub async fn leased_by(&mut self, worker: &str) -> Result<Vec<Fence>, StoreError> {
        let rows: Vec<(TaskId, Epoch)> =
            sql("SELECT id, epoch FROM task WHERE state = 'running' AND worker = $1")
                .bind(worker)
                .all(self)
                .await?;
        Ok(rows.into_iter().map(|(task, epoch)| Fence { task, epoch }).collect())
    }

    pub async fn set_attempt(&mut self, task: TaskId, attempt: u32) -> Result<(), StoreError> {
        sql("UPDATE task SET attempt = $1 WHERE id = $2").bind(attempt).bind(task).run(self).await
    }

    pub async fn set_total(&mut self, task: TaskId, total: u64) -> Result<(), StoreError> {
        sql("UPDATE task SET total = $1 WHERE id = $2").bind(total).bind(task).run(self).await
    }

    /// Ends a task that succeeded, and its attempt. Removes the task's error.
    pub async fn complete_task(
        &mut self,
        task: TaskId,
        standing: &TaskStanding,
        result: Option<&Value>,
    ) -> Result<(), StoreError> {
        sql("{both}UPDATE task SET state = $1, done = total, result = $2, error = NULL, \
             lease_until = NULL, rate = NULL, message = NULL, finished_at = {now} \
             WHERE id = $3{and} UPDATE attempt SET outcome = $4, reason = NULL, ended_at = {now} \
             WHERE task = $3 AND epoch = $5{end}")
        .bind(standing.state)
        .bind(result.map(Value::to_string))
        .bind(task)
        .bind(AttemptOutcome::Succeeded.as_str())
        .bind(standing.epoch)
        .run(self)
        .await
    }

    /// Ends a task. Without an `error` it keeps that of the last attempt.
    pub async fn end_task(
        &mut self,
        task: TaskId,
        standing: &TaskStanding,
        error: Option<&str>,
    ) -> Result<(), StoreError> {
        sql("UPDATE task SET state = $1, error = COALESCE($2, error), lease_until = NULL, rate = \
             NULL, message = NULL, finished_at = {now} WHERE id = $3")
        .bind(standing.state)
        .bind(error)
        .bind(task)
        .run(self)
        .await
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
    ) -> Result<(), StoreError> {
        sql("UPDATE task SET state = $1, attempt = $2, error = COALESCE($3, error), lease_until \
             = NULL, rate = NULL, message = NULL, run_at = \
             CASE WHEN $4 = 0 THEN 0 ELSE $4 * (750 + {chance}) / 1000 + {now} END WHERE id = $5")
        .bind(standing.state)
        .bind(standing.attempt)
        .bind(error)
        .bind(delay)
        .bind(task)
        .run(self)
        .await?;
        self.ring().await
    }

    /// Counts a job's tasks. Each part reads the first entry of an index, however many tasks the
    /// job has.
    pub async fn tally(&mut self, job: JobId) -> Result<TaskTally, StoreError> {
        let row = sql(
            "SELECT EXISTS (SELECT 1 FROM task WHERE job = $1 AND state = 'failed') AS failed, \
             EXISTS (SELECT 1 FROM task WHERE job = $1 AND state = 'cancelled') AS cancelled, \
             (SELECT MIN(stage) FROM task WHERE job = $1 AND state = 'waiting') AS waiting, \
             (SELECT MIN(stage) FROM task WHERE job = $1 AND state = 'queued') AS queued, \
             (SELECT MIN(stage) FROM task WHERE job = $1 AND state = 'running') AS running",
        )
        .bind(job)
        .row(self)
        .await?;
        let waiting_stage: Option<u32> = row.get("waiting")?;
        let claimable: Option<u32> = row.get("queued")?;
        let claimed: Option<u32> = row.get("running")?;
        Ok(TaskTally {
            failed: row.get("failed")?,
            cancelled: row.get("cancelled")?,
            open_stage: [waiting_stage, claimable, claimed].into_iter().flatten().min(),
            waiting_stage,
        })
    }

    /// The error of the first task of a job that failed.
    pub async fn first_failure(&mut self, job: JobId) -> Result<Option<String>, StoreError> {
        sql("SELECT label || ': ' || COALESCE(error, 'failed') FROM task \
             WHERE job = $1 AND state = 'failed' ORDER BY id LIMIT 1")
        .bind(job)
        .optional(self)
        .await
    }

    /// Queues the waiting tasks of a stage, all at once.
    pub async fn queue_stage(&mut self, job: JobId, stage: u32) -> Result<(), StoreError> {
        sql("UPDATE task SET state = 'queued', run_at = 0 \
             WHERE job = $1 AND stage = $2 AND state = 'waiting'")
        .bind(job)
        .bind(stage)
        .run(self)
        .await?;
        self.ring().await
    }

    /// Cancels queued tasks, and requests the cancellation of running tasks. The tests of `rules`
    /// check this against a model.
    pub async fn stop_tasks(&mut self, job: JobId) -> Result<(), StoreError> {
        sql("UPDATE task SET state = 'cancelled', finished_at = {now} WHERE job = $1 \
             AND state IN ('waiting', 'queued')")
        .bind(job)
        .changed(self)
        .await?;
        sql("UPDATE task SET cancel_requested = TRUE WHERE job = $1 AND state = 'running'")
            .bind(job)
            .changed(self)
            .await?;
        Ok(())
    }
}

from_row!(TaskStanding { state, attempt, max_attempts, epoch, cancel_requested });

impl FromRow for Leased {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let lasts: Option<i64> = row.get("lease_ms")?;
        let worker: Option<String> = row.get("worker")?;
        Ok(Self {
            fence: Fence { task: row.get("id")?, epoch: row.get("epoch")? },
            worker: worker.unwrap_or_default(),
            until: row.get("lease_until")?,
            lasts: Duration::from_millis(lasts.unwrap_or(USUAL_LEASE_MS).unsigned_abs()),
            has_passed: row.get("has_passed")?,
        })
    }
}

impl FromRow for NextTask {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let job_state = row.get("job_state")?;
        let standing = TaskStanding::from_row(row)?;
        Ok(Self { task: ClaimedTask::from_row(row)?, standing, job_state })
    }
}

impl FromRow for ClaimedTask {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let time_limit: Option<u32> = row.get("time_limit_s")?;
        Ok(Self {
            fence: Fence { task: row.get("id")?, epoch: row.get("epoch")? },
            job: row.get("job")?,
            kind: row.get("kind")?,
            spec: row.get("spec")?,
            digest: row.get("digest")?,
            run: row.get("run")?,
            stage: row.get("stage")?,
            ordinal: row.get("ordinal")?,
            label: row.get("label")?,
            payload: row.get("payload")?,
            total: row.get("total")?,
            attempt: row.get("attempt")?,
            max_attempts: row.get("max_attempts")?,
            time_limit: time_limit.map(|seconds| Duration::from_secs(u64::from(seconds))),
        })
    }
}

from_row!(Task {
    id, job, stage, ordinal, label, payload, state, attempt, max_attempts, epoch, worker,
    lease_until, cancel_requested, total, result, error, started_at, finished_at,
    ..row =>
    progress: Progress {
        done: row.get("done")?,
        rate_per_second: row.get("rate")?,
        message: row.get("message")?,
    },
});
