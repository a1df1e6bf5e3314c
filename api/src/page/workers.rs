//! The workers, and what each does.

use askama::Template;
use axum::extract::State;
use axum::response::{Redirect, Response};
use wire::{Queue, Worker, WorkersTask};

use crate::app::App;
use crate::page::answer::{PageError, html};
use crate::page::text::instant;

#[derive(Template)]
#[template(path = "workers.html")]
struct WorkersPage {
    queue: Queue,
    obstacles: Vec<String>,
    workers: Vec<WorkerRow>,
}

struct WorkerRow {
    name: String,
    host: String,
    pid: u32,
    version: String,
    device: String,
    threads: u32,
    seen_at: String,
    task: Option<WorkersTask>,
    /// In words, without a task.
    does: String,
}

pub async fn show(State(app): State<App>) -> Result<Response, PageError> {
    let workers = app.workers().await?;
    let page = WorkersPage {
        obstacles: app.obstacles(&workers).await?,
        queue: app.queue().await?,
        workers: workers.into_iter().map(WorkerRow::from).collect(),
    };
    Ok(html(&page)?)
}

/// Pauses the queue, and shows the page again.
pub async fn pause(State(app): State<App>) -> Result<Redirect, PageError> {
    app.pause_queue().await?;
    Ok(Redirect::to("/workers"))
}

/// Lets the queue go on, and shows the page again.
pub async fn resume(State(app): State<App>) -> Result<Redirect, PageError> {
    app.resume_queue().await?;
    Ok(Redirect::to("/workers"))
}

impl From<Worker> for WorkerRow {
    fn from(worker: Worker) -> Self {
        let does = match worker.waits_for {
            _ if !worker.alive => "nothing: it has died, or hangs".to_owned(),
            Some(reason) => format!("waits: {reason}"),
            None => "waits for a task".to_owned(),
        };
        Self {
            name: worker.name,
            host: worker.host,
            pid: worker.pid,
            version: worker.version,
            device: worker.device,
            threads: worker.threads,
            seen_at: instant(&worker.seen_at),
            task: worker.task.filter(|_| worker.alive),
            does,
        }
    }
}
