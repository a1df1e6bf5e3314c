use std::collections::BTreeMap;

use spec::{Digest, Moment};
use sqlx::Row;
use wire::JobState;

use super::rows::{number, state};
use super::{Database, DbRow, Transaction, integer};
use crate::lists::labels::searched;
use crate::queue::rules::reuse::{Earlier, TaskPlace};
use crate::queue::submission::{CompletedTask, JobRow};
use crate::{JobId, Labels, NewTask, Submitted, TaskId, Timestamp};

impl Database {
    /// Like [`Transaction::request`], for a key that is at most this many milliseconds old.
    pub async fn recent_request(
        &self,
        key: &str,
        age_ms: i64,
    ) -> Result<Option<(String, Submitted)>, sqlx::Error> {
        let known: Option<(String, JobId, bool)> = sqlx::query_as(concat!(
            "SELECT request, job, reused FROM idempotency_key WHERE key = $1 AND created_at >= ",
            now!(),
            " - $2"
        ))
        .bind(key)
        .bind(age_ms)
        .fetch_optional(&self.reader)
        .await?;
        Ok(known.map(|(request, job, reused)| (request, Submitted { job, reused })))
    }
}

impl Transaction {
    /// The outcome of the request with this key, and the request's digest.
    pub async fn request(&mut self, key: &str) -> Result<Option<(String, Submitted)>, sqlx::Error> {
        let known: Option<(String, JobId, bool)> =
            sqlx::query_as("SELECT request, job, reused FROM idempotency_key WHERE key = $1")
                .bind(key)
                .fetch_optional(self.connection())
                .await?;
        Ok(known.map(|(request, job, reused)| (request, Submitted { job, reused })))
    }

    pub async fn forget_requests(&mut self, older_than_ms: i64) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "DELETE FROM idempotency_key WHERE created_at < ",
            now!(),
            " - $1"
        ))
        .bind(older_than_ms);
        self.execute(statement).await
    }

    pub async fn remember_request(
        &mut self,
        key: &str,
        request: Digest,
        submitted: &Submitted,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO idempotency_key (key, request, job, reused, created_at) ",
            "VALUES ($1, $2, $3, $4, ",
            now!(),
            ")"
        ))
        .bind(key)
        .bind(request.to_string())
        .bind(submitted.job)
        .bind(submitted.reused);
        self.execute(statement).await
    }

    /// All jobs with this digest that did not fail, were not cancelled, and still have all their
    /// results.
    pub async fn earlier_jobs(&mut self, digest: Digest) -> Result<Vec<Earlier>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT id, state, cancel_requested, EXISTS (SELECT 1 FROM pipeline_member \
                 JOIN job AS member ON member.id = pipeline_member.job \
                 WHERE pipeline_member.pipeline = job.id \
                 AND member.state IN ('failed', 'cancelled')) AS can_only_fail \
             FROM job WHERE digest = $1 AND state NOT IN ('failed', 'cancelled') AND NOT ",
            is_gone!("job"),
            " AND NOT EXISTS (SELECT 1 FROM pipeline_member AS part JOIN job AS made ON made.id = part.job \
              WHERE part.pipeline = job.id AND ",
            is_gone!("made"),
            ")"
        ))
        .bind(digest.to_string())
        .fetch_all(self.connection())
        .await?;
        let earlier = |row: &DbRow| {
            Ok(Earlier {
                job: row.try_get("id")?,
                state: state(row)?,
                cancel_requested: row.try_get("cancel_requested")?,
                can_only_fail: row.try_get("can_only_fail")?,
            })
        };
        rows.iter().map(earlier).collect()
    }

    pub async fn insert_job(
        &mut self,
        row: &JobRow<'_>,
        state: JobState,
    ) -> Result<JobId, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "INSERT INTO job (kind, name, spec, digest, state, unit, priority, max_attempts, ",
            "time_limit_s, resources, not_before, waits_since, is_part, asked_alone, takes_over, ",
            "searched, created_at) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, ",
            "$14, $15, $16, ",
            now!(),
            ") RETURNING id"
        ))
        .bind(row.kind)
        .bind(row.name)
        .bind(row.spec.to_string())
        .bind(row.digest.to_string())
        .bind(state.as_str())
        .bind(row.unit)
        .bind(row.priority)
        .bind(i64::from(row.max_attempts))
        .bind(row.time_limit_s.map(i64::from))
        .bind(row.resources)
        .bind(row.not_before.map_or(0, Moment::milliseconds))
        .bind(row.waits_since)
        .bind(row.is_part)
        .bind(!row.is_part)
        .bind(row.takes_over)
        .bind(searched(Some(row.name), &Labels::default()))
        .fetch_one(self.connection())
        .await
    }

    pub async fn mark_asked_alone(&mut self, job: JobId) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query("UPDATE job SET asked_alone = TRUE WHERE id = $1 AND NOT asked_alone")
                .bind(job);
        self.execute(statement).await
    }

    /// Inserts the digests that a job's spec refers to.
    pub async fn insert_inputs(
        &mut self,
        job: JobId,
        digests: &[Digest],
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO job_input (job, digest) SELECT job.id, named.digest FROM job, ",
            "(SELECT DISTINCT value AS digest FROM ",
            listed_texts!("$2"),
            " AS listed) AS named WHERE job.id = $1"
        ))
        .bind(job)
        .bind(sqlx::types::Json(digests));
        self.execute(statement).await
    }

    /// Whether a job or one of its results was deleted.
    pub async fn job_is_gone(&mut self, job: JobId) -> Result<bool, sqlx::Error> {
        sqlx::query_scalar(concat!("SELECT ", is_gone!("job"), " FROM job WHERE job.id = $1"))
            .bind(job)
            .fetch_one(self.connection())
            .await
    }

    pub async fn insert_need(&mut self, job: JobId, needs: JobId) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query("INSERT INTO job_need (job, needs) VALUES ($1, $2)").bind(job).bind(needs);
        self.execute(statement).await
    }

    /// The moment since when a job waits that is submitted now. It is never earlier than that of
    /// another open job, even if the clock was set back. So an older job of the same priority goes
    /// first, and nobody waits for jobs that were submitted while a clock was far ahead.
    pub async fn waits_since(&mut self) -> Result<Timestamp, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "SELECT ",
            larger!(
                now!(),
                "COALESCE((SELECT MAX(waits_since) FROM job \
                  WHERE state NOT IN ('succeeded', 'failed', 'cancelled')), 0)"
            )
        ))
        .fetch_one(self.connection())
        .await
    }

    /// Inserts waiting tasks at the place `turn` in line, with the job's attempts, resources and
    /// start time.
    pub async fn insert_tasks(
        &mut self,
        job: JobId,
        turn: i64,
        tasks: &[NewTask],
    ) -> Result<(), sqlx::Error> {
        let rows: Vec<_> = tasks
            .iter()
            .map(|task| {
                let payload = task.payload.to_string();
                (task.stage, task.ordinal, &task.label, payload, integer(task.total))
            })
            .collect();
        let statement = sqlx::query(concat!(
            "INSERT INTO task (job, stage, ordinal, label, payload, state, turn, run_at, \
             max_attempts, resources, not_before, total) SELECT job.id, ",
            item!(integer 0),
            ", ",
            item!(integer 1),
            ", ",
            item!(text 2),
            ", ",
            item!(text 3),
            ", 'waiting', $3, 0, job.max_attempts, job.resources, job.not_before, ",
            item!(integer 4),
            " FROM ",
            items!("$1"),
            ", job WHERE job.id = $2 ORDER BY item.key"
        ))
        .bind(sqlx::types::Json(rows))
        .bind(job)
        .bind(turn);
        self.execute(statement).await
    }

    /// The newest task with a result at each place of the jobs with this digest.
    pub async fn completed_tasks(
        &mut self,
        digest: Digest,
    ) -> Result<Vec<CompletedTask>, sqlx::Error> {
        let rows = sqlx::query(concat!(
            "SELECT task.id, task.stage, task.ordinal, task.payload FROM task \
             JOIN job ON job.id = task.job WHERE job.digest = $1 \
             AND task.state = 'succeeded' AND task.result IS NOT NULL AND NOT ",
            is_gone!("job"),
            " ORDER BY task.id"
        ))
        .bind(digest.to_string())
        .fetch_all(self.connection())
        .await?;
        let mut newest: BTreeMap<(u32, u32), CompletedTask> = BTreeMap::new();
        for row in &rows {
            let place =
                TaskPlace { stage: number(row, "stage")?, ordinal: number(row, "ordinal")? };
            let (task, payload) = (row.try_get("id")?, row.try_get("payload")?);
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
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "UPDATE task SET state = 'succeeded', done = task.total, result = made.result, \
             worker = made.worker, started_at = made.started_at, finished_at = made.finished_at \
             FROM (SELECT result, worker, started_at, finished_at FROM task WHERE id = $1) AS made \
             WHERE task.job = $2 AND task.stage = $3 AND task.ordinal = $4",
        )
        .bind(from)
        .bind(job)
        .bind(i64::from(place.stage))
        .bind(i64::from(place.ordinal));
        self.execute(statement).await
    }
}
