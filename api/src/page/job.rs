//! One job or pipeline: its members or tasks, its results and its spec.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Redirect, Response};
use spec::JobKind;

use crate::app::{App, Job, JobState, Task, TaskState};
use crate::error::ApiError;
use crate::extract::Path;
use crate::page::parts::{Bar, Link, Row, key_metric, origin, pretty, when};
use crate::page::{InPage, PageError, html};

/// Tasks shown; the rest is one link away.
const TASKS: usize = 100;

#[derive(Template)]
#[template(path = "job.html")]
struct JobPage {
    id: i64,
    name: String,
    kind: JobKind,
    state: JobState,
    when: String,
    settled: bool,
    can_cancel: bool,
    error: String,
    digest: String,
    short_digest: String,
    progress: Option<Bar>,
    results: Vec<Link>,
    rows: Vec<Row>,
    tasks: Vec<TaskRow>,
    tasks_left_out: usize,
    spec: String,
    origin: String,
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
    let mut rows = Vec::with_capacity(job.members.len());
    for member in &job.members {
        rows.push(Row::of_member(member, key_metric(&app, member.job, member.kind).await?));
    }
    let tasks = app.tasks(id).await?;
    let page = JobPage {
        id,
        name: job.name.clone(),
        kind: job.kind,
        state: job.state,
        when: when(&job),
        settled: job.state.is_final(),
        can_cancel: !job.state.is_final(),
        error: job.error.clone().unwrap_or_default(),
        digest: job.digest.to_string(),
        short_digest: job.digest.short(),
        progress: Bar::of(job.state, &job.progress),
        results: results(&job),
        rows,
        tasks_left_out: tasks.len().saturating_sub(TASKS),
        tasks: tasks.into_iter().take(TASKS).map(TaskRow::from).collect(),
        spec: pretty(&job.spec),
        origin: origin(&headers),
    };
    Ok(html(&page)?)
}

/// What the job has made, wherever it is shown.
fn results(job: &Job) -> Vec<Link> {
    let dataset =
        job.dataset.map(|id| Link::new(format!("/datasets/{id}"), format!("Dataset {id}")));
    let run = match (job.kind, job.run) {
        (JobKind::Train, Some(run)) => {
            Some(Link::new(format!("/runs/{run}"), format!("Loss curve and metrics of run {run}")))
        }
        (JobKind::Evaluate, _) => {
            Some(Link::new(format!("/evaluations/{}", job.id), "RMSE figure and table"))
        }
        _ => None,
    };
    let checkpoints = job
        .checkpoints
        .iter()
        .rev()
        .take(1)
        .map(|id| Link::new(format!("/checkpoints/{id}"), format!("Last checkpoint ({id})")));
    dataset.into_iter().chain(run).chain(checkpoints).collect()
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
