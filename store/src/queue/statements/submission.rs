//! New jobs, as rows.

use std::collections::BTreeMap;

use spec::{Digest, Execution, Moment};
use wire::JobState;

use crate::database::column::json;
use crate::database::query::{Row, sql};
use crate::database::{Reading, Transaction};
use crate::lists::labels::searched;
use crate::queue::rules::reuse::{Earlier, TaskPlace};
use crate::{JobId, Labels, NewJob, NewTask, StoreError, Submitted, TaskId, Timestamp};

/// The row of a new job.
pub(crate) struct JobRow<'a> {
    pub new: &'a NewJob,
    pub state: JobState,
    /// The moment since when it has waited.
    pub waits_since: Timestamp,
    /// Whether it was made for a pipeline.
    pub is_part: bool,
    /// Whether its workers take over shards and checkpoints.
    pub takes_over: bool,
}

/// A task that succeeded and has a result.
pub(crate) struct CompletedTask {
    pub task: TaskId,
    pub place: TaskPlace,
    /// The payload as stored.
    pub payload: String,
}

impl Reading<'_> {
    /// Like [`Transaction::request`], for a key that is at most this many milliseconds old.
    pub async fn recent_request(
        &mut self,
        key: &str,
        age_ms: i64,
    ) -> Result<Option<(String, Submitted)>, StoreError> {
        let known: Option<(String, JobId, bool)> =
            sql("SELECT request, job, reused FROM idempotency_key WHERE key = $1 \
             AND created_at >= {now} - $2")
            .bind(key)
            .bind(age_ms)
            .optional(self)
            .await?;
        Ok(known.map(|(request, job, reused)| (request, Submitted { job, reused })))
    }
}

impl Transaction {
    /// The outcome of the request with this key, and the request's digest.
    pub async fn request(&mut self, key: &str) -> Result<Option<(String, Submitted)>, StoreError> {
        let known: Option<(String, JobId, bool)> =
            sql("SELECT request, job, reused FROM idempotency_key WHERE key = $1")
                .bind(key)
                .optional(self)
                .await?;
        Ok(known.map(|(request, job, reused)| (request, Submitted { job, reused })))
    }

    pub async fn forget_requests(&mut self, older_than_ms: i64) -> Result<(), StoreError> {
        sql("DELETE FROM idempotency_key WHERE created_at < {now} - $1")
            .bind(older_than_ms)
            .run(self)
            .await
    }

    pub async fn remember_request(
        &mut self,
        key: &str,
        request: Digest,
        submitted: &Submitted,
    ) -> Result<(), StoreError> {
        sql("INSERT INTO idempotency_key (key, request, job, reused, created_at) \
             VALUES ($1, $2, $3, $4, {now})")
        .bind(key)
        .bind(request.to_string())
        .bind(submitted.job)
        .bind(submitted.reused)
        .run(self)
        .await
    }

    /// All jobs with this digest that did not fail, were not cancelled, and still have all their
    /// results.
    pub async fn earlier_jobs(&mut self, digest: Digest) -> Result<Vec<Earlier>, StoreError> {
        let rows =
            sql("SELECT id, state, cancel_requested, EXISTS (SELECT 1 FROM pipeline_member \
             JOIN job AS member ON member.id = pipeline_member.job \
             WHERE pipeline_member.pipeline = job.id \
             AND member.state IN ('failed', 'cancelled')) AS can_only_fail FROM job \
             WHERE digest = $1 AND state NOT IN ('failed', 'cancelled') AND NOT {gone job} \
             AND NOT EXISTS (SELECT 1 FROM pipeline_member AS part JOIN job AS made \
             ON made.id = part.job WHERE part.pipeline = job.id AND {gone made})")
            .bind(digest)
            .rows(self)
            .await?;
        let earlier = |row: &Row| {
            Ok(Earlier {
                job: row.get("id")?,
                state: row.get("state")?,
                cancel_requested: row.get("cancel_requested")?,
                can_only_fail: row.get("can_only_fail")?,
            })
        };
        rows.iter().map(earlier).collect()
    }

    pub async fn insert_job(&mut self, row: &JobRow<'_>) -> Result<JobId, StoreError> {
        let JobRow { new, state, waits_since, is_part, takes_over } = *row;
        let Execution { priority, max_attempts, time_limit_s, resources, not_before } =
            &new.execution;
        let resources = self.resources_id(resources).await?;
        sql("INSERT INTO job (kind, name, spec, digest, state, unit, priority, max_attempts, \
             time_limit_s, resources, not_before, waits_since, is_part, asked_alone, takes_over, \
             searched, created_at) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, \
             $13, $14, $15, $16, {now}) RETURNING id")
        .bind(new.kind.as_str())
        .bind(new.name.as_str())
        .bind(new.spec.to_string())
        .bind(new.digest.to_string())
        .bind(state)
        .bind(new.unit.as_str())
        .bind(*priority)
        .bind(*max_attempts)
        .bind(*time_limit_s)
        .bind(resources)
        .bind(not_before.map_or(0, Moment::milliseconds))
        .bind(waits_since)
        .bind(is_part)
        .bind(!is_part)
        .bind(takes_over)
        .bind(searched(Some(&new.name), &Labels::default()))
        .one(self)
        .await
    }

    pub async fn mark_asked_alone(&mut self, job: JobId) -> Result<(), StoreError> {
        sql("UPDATE job SET asked_alone = TRUE WHERE id = $1 AND NOT asked_alone")
            .bind(job)
            .run(self)
            .await
    }

    /// Inserts the digests that a job's spec refers to.
    pub async fn insert_inputs(
        &mut self,
        job: JobId,
        digests: &[Digest],
    ) -> Result<(), StoreError> {
        sql("INSERT INTO job_input (job, digest) SELECT job.id, named.digest FROM job, \
             (SELECT DISTINCT value AS digest FROM {texts $2} AS listed) AS named \
             WHERE job.id = $1")
        .bind(job)
        .bind(json(&digests))
        .run(self)
        .await
    }

    /// Whether a job or one of its results was deleted.
    pub async fn job_is_gone(&mut self, job: JobId) -> Result<bool, StoreError> {
        sql("SELECT {gone job} FROM job WHERE job.id = $1").bind(job).one(self).await
    }

    pub async fn insert_need(&mut self, job: JobId, needs: JobId) -> Result<(), StoreError> {
        sql("INSERT INTO job_need (job, needs) VALUES ($1, $2)")
            .bind(job)
            .bind(needs)
            .run(self)
            .await
    }

    /// The moment since when a job waits that is submitted now. It is never earlier than that of
    /// another open job, even if the clock was set back. So an older job of the same priority goes
    /// first, and nobody waits for jobs that were submitted while a clock was far ahead.
    pub async fn waits_since(&mut self) -> Result<Timestamp, StoreError> {
        sql("SELECT {larger}({now}, COALESCE((SELECT MAX(waits_since) FROM job \
             WHERE state NOT IN ('succeeded', 'failed', 'cancelled')), 0))")
        .one(self)
        .await
    }

    /// Inserts waiting tasks at the place `turn` in line, with the job's attempts, resources and
    /// start time.
    pub async fn insert_tasks(
        &mut self,
        job: JobId,
        turn: i64,
        tasks: &[NewTask],
    ) -> Result<(), StoreError> {
        let rows: Vec<_> = tasks
            .iter()
            .map(|task| {
                let payload = task.payload.to_string();
                (task.stage, task.ordinal, &task.label, payload, task.total)
            })
            .collect();
        sql("INSERT INTO task (job, stage, ordinal, label, payload, state, turn, run_at, \
             max_attempts, resources, not_before, total) \
             SELECT job.id, {integer 0}, {integer 1}, {text 2}, {text 3}, 'waiting', $3, 0, \
             job.max_attempts, job.resources, job.not_before, {integer 4} FROM {items $1}, job \
             WHERE job.id = $2 ORDER BY item.key")
        .bind(json(&rows))
        .bind(job)
        .bind(turn)
        .run(self)
        .await
    }

    /// The newest task with a result at each place of the jobs with this digest.
    pub async fn completed_tasks(
        &mut self,
        digest: Digest,
    ) -> Result<Vec<CompletedTask>, StoreError> {
        let rows =
            sql("SELECT task.id, task.stage, task.ordinal, task.payload FROM task JOIN job \
             ON job.id = task.job WHERE job.digest = $1 AND task.state = 'succeeded' \
             AND task.result IS NOT NULL AND NOT {gone job} ORDER BY task.id")
            .bind(digest)
            .rows(self)
            .await?;
        let mut newest: BTreeMap<(u32, u32), CompletedTask> = BTreeMap::new();
        for row in &rows {
            let place = TaskPlace { stage: row.get("stage")?, ordinal: row.get("ordinal")? };
            let (task, payload) = (row.get("id")?, row.get("payload")?);
            newest.insert((place.stage, place.ordinal), CompletedTask { task, place, payload });
        }
        Ok(newest.into_values().collect())
    }

    /// Gives a new task the result of `from`, with its worker and times.
    pub async fn take_over(
        &mut self,
        job: JobId,
        place: TaskPlace,
        from: TaskId,
    ) -> Result<(), StoreError> {
        sql("UPDATE task SET state = 'succeeded', done = task.total, result = made.result, \
             worker = made.worker, started_at = made.started_at, finished_at = made.finished_at \
             FROM (SELECT result, worker, started_at, finished_at FROM task WHERE id = $1) AS made \
             WHERE task.job = $2 AND task.stage = $3 AND task.ordinal = $4")
        .bind(from)
        .bind(job)
        .bind(place.stage)
        .bind(place.ordinal)
        .run(self)
        .await
    }
}
