//! The page of a job or pipeline: its members or tasks, its results and its spec.

use std::slice;

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use serde::Deserialize;
use spec::JobKind;
use store::TaskOverview;
use wire::{Attempt, AttemptOutcome, TaskState};

use crate::app::logs::LogEnd;
use crate::app::tasks::{FirstTasks, progress};
use crate::app::{App, Paging};
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::page::answer::{InPage, PageError, html};
use crate::page::instant::Instant;
use crate::page::job_result::JobResult;
use crate::page::kinds::{headlines, own_page};
use crate::page::labels::Labelled;
use crate::page::lineage::Lineage;
use crate::page::parts::{Bar, Commands, FileLink, JobHeader, Link};
use crate::page::rows::{Row, comparison, results};
use crate::page::spec_text::Specification;

/// Number of tasks shown. A link leads to the others.
const TASKS: u32 = 100;

/// Number of attempts that are searched for failures.
const ATTEMPTS: u32 = 50;

#[derive(Template)]
#[template(path = "job.html")]
struct JobPage {
    job: JobHeader,
    labelled: Labelled,
    warnings: Vec<String>,
    /// Its outcome in words.
    outcome: String,
    /// The name and the tags that somebody typed who has just submitted it again.
    again: Option<Again>,
    digest: String,
    short_digest: String,
    results: Vec<Link>,
    result: Option<JobResult>,
    /// The picture of the jobs before and after it.
    lineage: Option<Lineage>,
    files: Vec<FileLink>,
    rows: Vec<Row>,
    /// The page that compares its runs, if it is a sweep.
    comparison: Option<String>,
    tasks: Vec<TaskRow>,
    tasks_left_out: u64,
    /// The id of the last task shown.
    last_task: i64,
    /// The newest attempts that ended without success.
    attempts: Vec<AttemptRow>,
    /// The last lines of the attempt that tells most about the job.
    log: Option<LogEnd>,
    spec: Specification,
    commands: Commands,
}

struct TaskRow {
    label: String,
    state: TaskState,
    attempt: u32,
    worker: String,
    error: String,
    progress: Option<Bar>,
}

struct AttemptRow {
    label: String,
    worker: String,
    outcome: &'static str,
    reason: String,
    ended_at: Option<Instant>,
    /// The address of its log. Empty without one.
    log: String,
}

/// The name and the tags that were typed for a job that existed before.
struct Again {
    name: String,
    tags: String,
}

/// The query of a page that a form led to.
#[derive(Deserialize)]
pub struct JustSubmitted {
    /// Given if the job existed before.
    again: Option<String>,
    #[serde(default)]
    name: String,
    #[serde(default)]
    tags: String,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
    InPage(Query(submitted)): InPage<Query<JustSubmitted>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let job = app.job(id).await?;
    let rows = match job.kind {
        JobKind::Pipeline => {
            let rows = Row::of_each(&app, slice::from_ref(&job)).await?;
            rows.into_iter().flatten().collect()
        }
        _ => Vec::<Row>::new(),
    };
    let FirstTasks { tasks, all } = app.first_tasks(id, TASKS).await?;
    let attempts = app.attempts(id, Paging { limit: ATTEMPTS, before: None }).await?.attempts;
    let log = app.newest_log(&job, &attempts).await?;
    let outcome = headlines(&app, &[&job]).await?.remove(&id).unwrap_or_default();
    let result = JobResult::of(&app, &job).await?;
    let files = match job.run {
        Some(run) if own_page(job.kind, id, run).is_none() => app.run(run).await?.artifacts,
        _ => Vec::new(),
    };
    let lineage = Lineage::of(&app, &job).await?;
    let page = JobPage {
        job: JobHeader::of(&job),
        labelled: Labelled::of_job(&job),
        warnings: job.warnings.clone(),
        outcome,
        again: submitted.again.map(|_| Again { name: submitted.name, tags: submitted.tags }),
        digest: job.digest.to_string(),
        short_digest: job.digest.short(),
        results: results(&job),
        result,
        files: files.into_iter().map(FileLink::from).collect(),
        comparison: comparison(&rows),
        rows,
        tasks_left_out: all.saturating_sub(tasks.len() as u64),
        last_task: tasks.last().map_or(0, |task| task.id.0),
        tasks: tasks.into_iter().map(|task| TaskRow::new(task, &job.progress.unit)).collect(),
        attempts: attempts.into_iter().filter_map(AttemptRow::of_unsuccessful).collect(),
        log,
        spec: Specification::new(&job.spec, lineage.as_ref()),
        lineage,
        commands: Commands::new(&headers),
    };
    Ok(html(&page)?)
}

impl AttemptRow {
    fn of_unsuccessful(attempt: Attempt) -> Option<Self> {
        let outcome = attempt.outcome.filter(|outcome| *outcome != AttemptOutcome::Succeeded)?;
        Some(Self {
            label: attempt.label,
            worker: attempt.worker,
            outcome: outcome.as_str(),
            reason: attempt.reason.unwrap_or_default(),
            ended_at: attempt.ended_at.as_deref().map(Instant::new),
            log: attempt.log.unwrap_or_default(),
        })
    }
}

impl TaskRow {
    fn new(task: TaskOverview, unit: &str) -> Self {
        let is_running = task.state == TaskState::Running;
        let progress = is_running.then(|| Bar::new(&progress(task.progress, task.total, unit)));
        Self {
            progress,
            label: task.label,
            state: task.state,
            attempt: task.attempt,
            worker: task.worker.unwrap_or_default(),
            error: task.error.unwrap_or_default(),
        }
    }
}

/// Submits the job's spec again and shows the new job; one that has not failed is no error to its reader.
pub async fn retry(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    let shown = match app.retry(id).await {
        Ok(submitted) => submitted.job.id,
        Err(ApiError::NotFailed { .. }) => id,
        Err(error) => return Err(error.into()),
    };
    Ok(Redirect::to(&format!("/jobs/{shown}")).into_response())
}
