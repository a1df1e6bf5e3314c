//! The logs of attempts at tasks.

use std::time::{Duration, Instant};

use store::{JobId, LogFilter, LogPage, NewLogChunk, StoreError, TaskId};
use wire::{Attempt, AttemptOutcome, Job, JobState, LogChunk, Logs, left_out};

use crate::app::App;
use crate::app::files::Download;
use crate::error::ApiError;
use crate::limits::{LOG_POLL, LOG_WAIT_SECONDS, LOGS_DEFAULT, LOGS_MAXIMUM};

/// The requested part of a job's logs.
#[derive(Clone, Debug, Default)]
pub struct LogQuery {
    /// The label or the id of a task.
    pub task: Option<String>,
    pub attempt: Option<i64>,
    pub after: Option<i64>,
    pub before: Option<i64>,
    /// Largest number of chunks.
    pub limit: Option<u32>,
    /// Seconds to wait for chunks after `after`.
    pub wait: Option<u32>,
}

/// The last lines of an attempt.
pub struct LogEnd {
    pub attempt: i64,
    /// The task's label.
    pub label: String,
    pub text: String,
}

impl LogQuery {
    fn page(&self) -> Result<LogPage, ApiError> {
        let limit = self.limit.unwrap_or(LOGS_DEFAULT);
        if !(1..=LOGS_MAXIMUM).contains(&limit) {
            return Err(ApiError::parameter("limit", limit, format!("1 to {LOGS_MAXIMUM}")));
        }
        match (self.after, self.before) {
            (Some(_), Some(before)) => {
                Err(ApiError::parameter("before", before, "nothing beside after"))
            }
            (Some(id), None) => Ok(LogPage::After { id, limit }),
            (None, id) => Ok(LogPage::Before { id, limit }),
        }
    }

    fn wait(&self) -> Result<Duration, ApiError> {
        match self.wait {
            Some(wait) if self.after.is_none() => {
                Err(ApiError::parameter("wait", wait, "nothing without after"))
            }
            Some(wait) if wait > LOG_WAIT_SECONDS => {
                Err(ApiError::parameter("wait", wait, format!("0 to {LOG_WAIT_SECONDS}")))
            }
            wait => Ok(Duration::from_secs(wait.unwrap_or(0).into())),
        }
    }
}

impl App {
    /// A page of the logs of a job, or of all jobs of a pipeline. If requested, waits for new
    /// lines. If too many requests wait already, the answer comes at once.
    ///
    /// # Errors
    /// When the job does not exist, or the task or attempt does not belong to it.
    pub(crate) async fn logs(&self, job: i64, query: &LogQuery) -> Result<Logs, ApiError> {
        let (page, wait) = (query.page()?, query.wait()?);
        let filter = self.log_filter(job, query).await?;
        let place = (!wait.is_zero()).then(|| self.places.log_reader()).flatten();
        let until = Instant::now() + if place.is_some() { wait } else { Duration::ZERO };
        let mut closing = std::pin::pin!(self.places.closing());
        loop {
            // This is read first, so a log that ends in between is complete in the page.
            let may_grow = self.store.may_log(&filter).await?;
            let chunks = self.store.log_page(&filter, page).await?;
            if !chunks.is_empty() || !may_grow || Instant::now() >= until {
                return Ok(answer(chunks, page, may_grow));
            }
            tokio::select! {
                () = tokio::time::sleep(LOG_POLL) => {}
                () = &mut closing => return Ok(answer(chunks, page, may_grow)),
            }
        }
    }

    async fn log_filter(&self, job: i64, query: &LogQuery) -> Result<LogFilter, ApiError> {
        let pipeline = JobId(job);
        self.store.job(pipeline).await?;
        let members = self.store.members(&[pipeline]).await?;
        let mut jobs: Vec<JobId> = members.into_iter().map(|member| member.job).collect();
        jobs.push(pipeline);
        let tasks = match &query.task {
            Some(task) => Some(self.tasks_named(&jobs, task).await?),
            None => None,
        };
        if let Some(id) = query.attempt {
            let allowed = || ApiError::parameter("attempt", id, "the id of an attempt at a task");
            let attempt = match self.store.attempt(id).await {
                Err(StoreError::NotFound { .. }) => return Err(allowed()),
                found => found?,
            };
            let task = self.store.task(attempt.task).await?;
            let is_wanted = tasks.as_ref().is_none_or(|tasks| tasks.contains(&task.id));
            if !is_wanted || !jobs.contains(&task.job) {
                return Err(allowed());
            }
        }
        Ok(LogFilter { jobs, tasks, attempt: query.attempt })
    }

    async fn tasks_named(&self, jobs: &[JobId], name: &str) -> Result<Vec<TaskId>, ApiError> {
        let tasks = match name.parse() {
            Ok(id) => match self.store.task(TaskId(id)).await {
                Ok(task) if jobs.contains(&task.job) => vec![task.id],
                Ok(_) | Err(StoreError::NotFound { .. }) => Vec::new(),
                Err(error) => return Err(error.into()),
            },
            Err(_) => self.store.tasks_labelled(jobs, name).await?,
        };
        if tasks.is_empty() {
            return Err(ApiError::parameter(
                "task",
                name,
                "the label or the id of a task of the job",
            ));
        }
        Ok(tasks)
    }

    /// The log of an attempt as a file.
    ///
    /// # Errors
    /// When the attempt does not exist, or its log was deleted.
    pub(crate) async fn attempt_log(&self, id: i64) -> Result<Download, ApiError> {
        let attempt = self.store.attempt(id).await?;
        let task = self.store.task(attempt.task).await?;
        self.store.job(task.job).await?;
        let chunks = self.store.attempt_log(id).await?;
        if chunks.is_empty() && attempt.ended_at.is_some() {
            return Err(ApiError::not_found("log of attempt", id));
        }
        let name = format!("{}-attempt-{id}.log", attempt.label);
        let text = with_gaps(chunks);
        Ok(Download::made(name, "text/plain; charset=utf-8", text.into_bytes()))
    }

    /// The last lines of the log of the newest running attempt, which may not have any yet. If none runs, those of the
    /// newest attempt that failed, or, if the job succeeded, of its last one. `attempts` are those of the job, the newest
    /// first.
    pub(crate) async fn newest_log(
        &self,
        job: &Job,
        attempts: &[Attempt],
    ) -> Result<Option<LogEnd>, ApiError> {
        if let Some(running) = attempts.iter().find(|attempt| attempt.outcome.is_none()) {
            return Ok(Some(self.log_end(job.id, running).await?));
        }
        let is_told = |attempt: &&Attempt| {
            job.state == JobState::Succeeded || attempt.outcome != Some(AttemptOutcome::Succeeded)
        };
        match attempts.iter().filter(is_told).find(|attempt| attempt.log.is_some()) {
            Some(attempt) => Ok(Some(self.log_end(job.id, attempt).await?)),
            None => Ok(None),
        }
    }

    /// The last lines of an attempt's log, about one screen.
    async fn log_end(&self, job: i64, attempt: &Attempt) -> Result<LogEnd, ApiError> {
        const LINES: usize = 40;
        // A chunk has at least one line.
        const CHUNKS: u32 = 40;
        let filter = LogFilter { jobs: vec![JobId(job)], tasks: None, attempt: Some(attempt.id) };
        let page = LogPage::Before { id: None, limit: CHUNKS };
        let chunks = self.store.log_page(&filter, page).await?;
        let chunks = chunks
            .into_iter()
            .map(|chunk| NewLogChunk { position: chunk.position, text: chunk.text });
        let text = with_gaps(chunks);
        let first = text.lines().count().saturating_sub(LINES);
        let text = text.split_inclusive('\n').skip(first).collect();
        Ok(LogEnd { attempt: attempt.id, label: attempt.label.clone(), text })
    }
}

/// Consecutive chunks of one attempt, with a line for each gap.
fn with_gaps(chunks: impl IntoIterator<Item = NewLogChunk>) -> String {
    let mut text = String::new();
    let mut end = None;
    for chunk in chunks {
        if let Some(end) = end.filter(|end| *end < chunk.position) {
            text.push_str(&left_out(chunk.position - end));
        }
        text.push_str(&chunk.text);
        end = Some(chunk.end());
    }
    text
}

fn answer(chunks: Vec<store::LogChunk>, page: LogPage, may_grow: bool) -> Logs {
    let (first, last) = (chunks.first().map(|chunk| chunk.id), chunks.last().map(|chunk| chunk.id));
    let is_full = |limit| u32::try_from(chunks.len()).is_ok_and(|found| found >= limit);
    let (next, previous, is_last) = match page {
        LogPage::After { id, limit } => (last.unwrap_or(id), first, !is_full(limit)),
        LogPage::Before { id, limit } => {
            (last.unwrap_or(0), first.filter(|_| is_full(limit)), id.is_none())
        }
    };
    let chunks = chunks.into_iter().map(chunk).collect();
    Logs { chunks, next, previous, complete: is_last && !may_grow }
}

fn chunk(row: store::LogChunk) -> LogChunk {
    LogChunk {
        id: row.id,
        attempt: row.attempt,
        task: row.task.0,
        label: row.label,
        worker: row.worker,
        position: row.position,
        text: row.text,
        written_at: row.written_at.to_string(),
    }
}
