//! The logs of attempts. They are rows and not files, so every database has them wherever its
//! workers run.
//!
//! A log is chunks of lines, with their positions among all bytes that the attempt has logged. The
//! distance between two chunks shows what was left out, in memory or later. A reader goes on from
//! the id of a chunk. In PostgreSQL transactions that insert chunks of one job take turns, so their
//! ids appear in their order.

use crate::boxed;
use crate::database::{Scope, sql};
use crate::queue::leases;
use crate::{Attempt, Fence, JobId, Store, StoreError, TaskId, Timestamp};

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
    pub attempt: i64,
    pub task: TaskId,
    /// The task's label.
    pub label: String,
    pub worker: String,
    /// See [`NewLogChunk`]. Bytes between two chunks were dropped.
    pub position: u64,
    pub text: String,
    pub written_at: Timestamp,
}

/// Selects logs.
#[derive(Clone, Debug, Default)]
pub struct LogFilter {
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
    After { id: i64, limit: u32 },
    /// The last chunks with a smaller id, or the last of all; `limit` at most.
    Before { id: Option<i64>, limit: u32 },
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
        let (mut tx, job, _) = leases::held_or_rolled_back(tx, fence).await?;
        // A task that was claimed by a version without attempts has none.
        let Some(attempt) = sql!(&mut tx, attempt_at(fence))? else { return Ok(()) };
        sql!(&mut tx, insert_log(job, attempt, chunks))?;
        let logged = last.end();
        sql!(&mut tx, set_log_bytes(attempt, logged))?;
        let tail = logged.saturating_sub(Self::LOG_TAIL_BYTES);
        if tail > Self::LOG_HEAD_BYTES {
            sql!(&mut tx, delete_log_between(attempt, Self::LOG_HEAD_BYTES, tail))?;
        }
        if first.position == 0 {
            for old in sql!(&mut tx, forget_logs(job, Self::LOGS_PER_JOB))? {
                sql!(&mut tx, delete_log(old))?;
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
            LogPage::After { id, limit } => {
                sql!(self.database(), READING, log_after(filter, id, limit))
            }
            LogPage::Before { id, limit } => {
                let mut chunks = sql!(self.database(), READING, log_before(filter, id, limit))?;
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
            (Some(attempt), _) => sql!(self.database(), READING, is_attempt_running(attempt)),
            (None, Some(tasks)) => sql!(self.database(), READING, are_tasks_open(tasks)),
            (None, None) => sql!(self.database(), READING, are_jobs_open(&filter.jobs)),
        }
    }

    /// The log of an attempt, without the dropped bytes.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn attempt_log(&self, attempt: i64) -> Result<Vec<NewLogChunk>, StoreError> {
        sql!(self.database(), READING, attempt_log(attempt))
    }

    /// # Errors
    /// When there is no such attempt.
    #[boxed]
    pub async fn attempt(&self, id: i64) -> Result<Attempt, StoreError> {
        sql!(self.database(), "reading an attempt", attempt(id))?
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
        sql!(self.database(), "looking for a task", tasks_labelled(jobs, label))
    }
}

const READING: &str = "reading logs";
