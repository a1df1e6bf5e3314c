//! The logs of attempts. They are rows and not files, so every database has them wherever its
//! workers run.
//!
//! A log is chunks of lines, with their positions among all bytes that the attempt has logged. The
//! distance between two chunks shows what was left out, in memory or later. A reader goes on from
//! the id of a chunk. In PostgreSQL transactions that insert chunks of one job take turns, so their
//! ids appear in their order.

use crate::database::column::json;
use crate::database::query::{from_row, sql};
use crate::database::{Reading, Scope, Transaction};
use crate::queue::fences;
use crate::{Attempt, Fence, JobId, Store, StoreError, TaskId, Timestamp, boxed};

/// Finds the ids of chunks first, because texts are long and should not be sorted. `$1` to `$3` are
/// the filter, `$4` is an id and `$5` the number of chunks.
macro_rules! select_chunks {
    ($comparison:literal, $order:literal) => {
        concat!(
            "SELECT chunk.*, attempt.task, attempt.worker, task.label \
             FROM attempt_log AS chunk JOIN attempt ON attempt.id = chunk.attempt \
             JOIN task ON task.id = attempt.task \
             WHERE chunk.id IN (SELECT chunk.id FROM attempt_log AS chunk \
                 JOIN attempt ON attempt.id = chunk.attempt \
                 WHERE chunk.job IN ",
            "{ids $1}",
            " \
                 AND ($2 IS NULL OR attempt.task IN ",
            "{ids $2}",
            ") \
                 AND ($3 IS NULL OR attempt.id = $3) AND chunk.id ",
            $comparison,
            " $4 ORDER BY chunk.id ",
            $order,
            " LIMIT $5) ORDER BY chunk.id ",
            $order
        )
    };
}

/// Lines that a worker adds to the log of its attempt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewLogChunk {
    /// Number of bytes that the attempt logged before, including dropped ones.
    pub position: u64,
    /// Whole lines, [`Store::LOG_CHUNK_BYTES`] at most. They contain no NUL, because not every
    /// database can store it in text.
    pub text: String,
}

/// Lines of the log of an attempt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogChunk {
    /// Grows from chunk to chunk of a job, for all attempts together.
    pub id: i64,
    /// The id of the attempt that wrote it.
    pub attempt: i64,
    /// The task of the attempt.
    pub task: TaskId,
    /// The task's label.
    pub label: String,
    /// The name of the worker.
    pub worker: String,
    /// See [`NewLogChunk`]. Bytes between two chunks were dropped.
    pub position: u64,
    /// Whole lines.
    pub text: String,
    /// When it was stored.
    pub written_at: Timestamp,
}

/// Selects logs.
#[derive(Clone, Debug, Default)]
pub struct LogFilter {
    /// Logs of attempts at tasks of these jobs.
    pub jobs: Vec<JobId>,
    /// Only logs of these tasks.
    pub tasks: Option<Vec<TaskId>>,
    /// Only the log of this attempt.
    pub attempt: Option<i64>,
}

/// Part of the logs, oldest first.
#[derive(Clone, Copy, Debug)]
pub enum LogPage {
    /// The first chunks with a larger id, `limit` at most.
    After {
        /// The last chunk that the reader has; 0 for none.
        id: i64,
        /// The largest number of chunks.
        limit: u32,
    },
    /// The last chunks with a smaller id, or the last of all; `limit` at most.
    Before {
        /// The first chunk that the reader has; `None` if it has none.
        id: Option<i64>,
        /// The largest number of chunks.
        limit: u32,
    },
}

impl NewLogChunk {
    /// Number of bytes that the attempt has logged up to the end of this chunk.
    pub fn end(&self) -> u64 {
        self.position + self.text.len() as u64
    }
}

impl Store {
    /// The largest number of bytes of a chunk. The schema has the same limit.
    pub const LOG_CHUNK_BYTES: usize = 16 << 10;

    /// Number of bytes kept from the beginning of an attempt's log.
    pub const LOG_HEAD_BYTES: u64 = 256 << 10;

    /// Number of bytes kept from the end of an attempt's log. The bytes between are dropped.
    pub const LOG_TAIL_BYTES: u64 = 768 << 10;

    /// Number of ended attempts of a job that keep their logs: the newest ones.
    pub const LOGS_PER_JOB: u32 = 200;

    /// Adds to the log of a running attempt. Deletes what exceeds the limits of this log and of the
    /// logs of older attempts of its job. Existing chunks are replaced, because a worker that got
    /// no answer sends them again.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. Nothing has changed then.
    #[boxed]
    pub async fn append_log(&self, fence: Fence, chunks: &[NewLogChunk]) -> Result<(), StoreError> {
        let (Some(first), Some(last)) = (chunks.first(), chunks.last()) else { return Ok(()) };
        let tx = self.begin(Scope::Rows, "adding to the log of an attempt").await?;
        let (mut tx, job, _) = fences::held_or_rolled_back(tx, fence).await?;
        // A task that was claimed by a version without attempts has none.
        let Some(attempt) = tx.attempt_at(fence).await? else { return Ok(()) };
        tx.insert_log(job, attempt, chunks).await?;
        let logged = last.end();
        tx.set_log_bytes(attempt, logged).await?;
        let tail = logged.saturating_sub(Self::LOG_TAIL_BYTES);
        if tail > Self::LOG_HEAD_BYTES {
            tx.delete_log_between(attempt, Self::LOG_HEAD_BYTES, tail).await?;
        }
        if first.position == 0 {
            for old in tx.forget_logs(job, Self::LOGS_PER_JOB).await? {
                tx.delete_log(old).await?;
            }
        }
        tx.commit().await
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn log_page(
        &self,
        filter: &LogFilter,
        page: LogPage,
    ) -> Result<Vec<LogChunk>, StoreError> {
        match page {
            LogPage::After { id, limit } => self.read(READING).log_after(filter, id, limit).await,
            LogPage::Before { id, limit } => {
                let mut chunks = self.read(READING).log_before(filter, id, limit).await?;
                chunks.reverse();
                Ok(chunks)
            }
        }
    }

    /// Whether more chunks may still be added to the selected logs.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn may_log(&self, filter: &LogFilter) -> Result<bool, StoreError> {
        match (filter.attempt, &filter.tasks) {
            (Some(attempt), _) => self.read(READING).is_attempt_running(attempt).await,
            (None, Some(tasks)) => self.read(READING).are_tasks_open(tasks).await,
            (None, None) => self.read(READING).are_jobs_open(&filter.jobs).await,
        }
    }

    /// The log of an attempt, without the dropped bytes.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn attempt_log(&self, attempt: i64) -> Result<Vec<NewLogChunk>, StoreError> {
        sql("SELECT position, text FROM attempt_log WHERE attempt = $1 ORDER BY position")
            .bind(attempt)
            .all(&mut self.read(READING))
            .await
    }

    /// # Errors
    /// When there is no such attempt.
    #[boxed]
    pub async fn attempt(&self, id: i64) -> Result<Attempt, StoreError> {
        self.read("reading an attempt")
            .attempt(id)
            .await?
            .ok_or_else(|| StoreError::not_found("attempt", id.to_string()))
    }

    /// The tasks of `jobs` with this label.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tasks_labelled(
        &self,
        jobs: &[JobId],
        label: &str,
    ) -> Result<Vec<TaskId>, StoreError> {
        sql("SELECT id FROM task WHERE job IN {ids $1} AND label = $2 ORDER BY id")
            .bind(json(&jobs))
            .bind(label)
            .all(&mut self.read("looking for a task"))
            .await
    }
}

const READING: &str = "reading logs";

impl Reading<'_> {
    /// Oldest first.
    pub async fn log_after(
        &mut self,
        filter: &LogFilter,
        id: i64,
        limit: u32,
    ) -> Result<Vec<LogChunk>, StoreError> {
        sql(select_chunks!(">", "ASC"))
            .bind(json(&filter.jobs))
            .bind(filter.tasks.as_ref().map(json))
            .bind(filter.attempt)
            .bind(id)
            .bind(limit)
            .all(self)
            .await
    }

    /// Newest first.
    pub async fn log_before(
        &mut self,
        filter: &LogFilter,
        id: Option<i64>,
        limit: u32,
    ) -> Result<Vec<LogChunk>, StoreError> {
        sql(select_chunks!("<", "DESC"))
            .bind(json(&filter.jobs))
            .bind(filter.tasks.as_ref().map(json))
            .bind(filter.attempt)
            .bind(id.unwrap_or(i64::MAX))
            .bind(limit)
            .all(self)
            .await
    }

    pub async fn attempt(&mut self, id: i64) -> Result<Option<Attempt>, StoreError> {
        sql("SELECT attempt.*, task.label FROM attempt JOIN task ON task.id = attempt.task \
             WHERE attempt.id = $1")
        .bind(id)
        .optional(self)
        .await
    }

    pub async fn is_attempt_running(&mut self, id: i64) -> Result<bool, StoreError> {
        sql("SELECT EXISTS (SELECT 1 FROM attempt WHERE id = $1 AND ended_at IS NULL)")
            .bind(id)
            .one(self)
            .await
    }

    /// Whether any of the tasks has not ended.
    pub async fn are_tasks_open(&mut self, tasks: &[TaskId]) -> Result<bool, StoreError> {
        sql("SELECT EXISTS (SELECT 1 FROM task WHERE id IN {ids $1} \
             AND state IN ('waiting', 'queued', 'running'))")
        .bind(json(&tasks))
        .one(self)
        .await
    }

    /// Whether any of the jobs has not ended, or has ended while a worker still has one of its
    /// tasks.
    pub async fn are_jobs_open(&mut self, jobs: &[JobId]) -> Result<bool, StoreError> {
        sql("SELECT EXISTS (SELECT 1 FROM job WHERE id IN {ids $1} \
             AND state IN ('waiting', 'queued', 'running')) OR EXISTS (SELECT 1 FROM attempt \
             WHERE job IN {ids $1} AND ended_at IS NULL)")
        .bind(json(&jobs))
        .one(self)
        .await
    }
}

impl Transaction {
    /// The attempts stay.
    pub async fn delete_logs_of_jobs(&mut self, jobs: &[JobId]) -> Result<(), StoreError> {
        sql("UPDATE attempt SET log_bytes = NULL WHERE log_bytes IS NOT NULL AND job IN {ids $1}")
            .bind(json(&jobs))
            .run(self)
            .await?;
        sql("DELETE FROM attempt_log WHERE job IN {ids $1}").bind(json(&jobs)).run(self).await
    }

    pub async fn attempt_at(&mut self, fence: Fence) -> Result<Option<i64>, StoreError> {
        sql("SELECT id FROM attempt WHERE task = $1 AND epoch = $2")
            .bind(fence.task)
            .bind(fence.epoch)
            .optional(self)
            .await
    }

    /// Replaces chunks at the same positions. Transactions that insert chunks of one job wait for
    /// each other. Otherwise a reader would see an id before a smaller one.
    pub async fn insert_log(
        &mut self,
        job: JobId,
        attempt: i64,
        chunks: &[NewLogChunk],
    ) -> Result<(), StoreError> {
        self.wait_for_turn(job).await?;
        for chunk in chunks {
            sql("INSERT INTO attempt_log (job, attempt, position, text, written_at) \
                 VALUES ($1, $2, $3, $4, {now}) ON CONFLICT (attempt, position) DO UPDATE \
                 SET text = excluded.text")
            .bind(job)
            .bind(attempt)
            .bind(chunk.position)
            .bind(&chunk.text)
            .run(self)
            .await?;
        }
        Ok(())
    }

    pub async fn set_log_bytes(&mut self, attempt: i64, bytes: u64) -> Result<(), StoreError> {
        sql("UPDATE attempt SET log_bytes = $1 WHERE id = $2")
            .bind(bytes)
            .bind(attempt)
            .run(self)
            .await
    }

    /// Deletes the chunks that begin at `from` or later, and before `to`.
    pub async fn delete_log_between(
        &mut self,
        attempt: i64,
        from: u64,
        to: u64,
    ) -> Result<(), StoreError> {
        sql("DELETE FROM attempt_log WHERE attempt = $1 AND position >= $2 AND position < $3")
            .bind(attempt)
            .bind(from)
            .bind(to)
            .run(self)
            .await
    }

    /// Marks the ended attempts of a job, except the newest `kept`, as having no log, and returns
    /// them.
    pub async fn forget_logs(&mut self, job: JobId, kept: u32) -> Result<Vec<i64>, StoreError> {
        sql("UPDATE attempt SET log_bytes = NULL WHERE id IN (SELECT id FROM attempt \
                 WHERE job = $1 AND log_bytes IS NOT NULL AND ended_at IS NOT NULL \
                 ORDER BY id DESC LIMIT 9223372036854775807 OFFSET $2) RETURNING id")
        .bind(job)
        .bind(kept)
        .all(self)
        .await
    }

    pub async fn delete_log(&mut self, attempt: i64) -> Result<(), StoreError> {
        sql("DELETE FROM attempt_log WHERE attempt = $1").bind(attempt).run(self).await
    }
}

from_row!(LogChunk { id, attempt, task, label, worker, position, text, written_at });

from_row!(NewLogChunk { position, text });
