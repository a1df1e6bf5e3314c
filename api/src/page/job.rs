//! One job or pipeline: its members or tasks, its results and its spec.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use wire::{Task, TaskState};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::control::ClosedLoop;
use crate::page::kinds::{closed_loop, headline, own_page};
use crate::page::parts::{Bar, Commands, FileLink, Link, Standing};
use crate::page::rows::{Row, results};
use crate::page::spec_text::spec_text;

/// Tasks shown; the rest is one link away.
const TASKS: usize = 100;

#[derive(Template)]
#[template(path = "job.html")]
struct JobPage {
    job: Standing,
    warnings: Vec<String>,
    /// What came of it, in words.
    outcome: String,
    digest: String,
    short_digest: String,
    results: Vec<Link>,
    closed_loop: Option<ClosedLoop>,
    files: Vec<FileLink>,
    rows: Vec<Row>,
    tasks: Vec<TaskRow>,
    tasks_left_out: usize,
    spec: String,
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

pub async fn show(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let job = app.job(id).await?;
    let rows = Row::of_members(&app, &job).await?;
    let tasks = app.tasks(id).await?;
    let outcome = headline(&app, &job).await?;
    let closed_loop = closed_loop(&app, &job).await?;
    let files = match job.run {
        Some(run) if own_page(job.kind, id, run).is_none() => app.run(run).await?.artifacts,
        _ => Vec::new(),
    };
    let page = JobPage {
        job: Standing::of(&job),
        warnings: job.warnings.clone(),
        outcome,
        digest: job.digest.to_string(),
        short_digest: job.digest.short(),
        results: results(&job),
        closed_loop,
        files: files.into_iter().map(FileLink::from).collect(),
        rows,
        tasks_left_out: tasks.len().saturating_sub(TASKS),
        tasks: tasks.into_iter().take(TASKS).map(TaskRow::from).collect(),
        spec: spec_text(&job.spec),
        commands: Commands::new(&app, &headers),
    };
    Ok(html(&page)?)
}

impl From<Task> for TaskRow {
    fn from(task: Task) -> Self {
        let progress = (task.state == TaskState::Running).then(|| Bar::new(&task.progress));
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

/// Cancels and shows the job; one that has just ended by itself is no error to its reader.
pub async fn cancel(
    State(app): State<App>,
    InPage(Path(id)): InPage<Path<i64>>,
) -> Result<Response, PageError> {
    match app.cancel(id).await {
        Ok(_) | Err(ApiError::AlreadyFinal { .. }) => {
            Ok(Redirect::to(&format!("/jobs/{id}")).into_response())
        }
        Err(error) => Err(error.into()),
    }
}
