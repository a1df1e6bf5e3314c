//! The page of workers with their tasks.

use askama::Template;
use axum::extract::State;
use axum::response::{Redirect, Response};
use wire::{Placement, PlacementState, Queue, Worker, Workers, WorkersTask};

use crate::app::App;
use crate::extract::Path;
use crate::page::answer::{InPage, PageError, html};
use crate::page::instant::Instant;
use crate::page::note::Note;

#[derive(Template)]
#[template(path = "workers.html")]
struct WorkersPage {
    queue: Queue,
    obstacles: Vec<Note>,
    workers: Vec<WorkerRow>,
    placements: Vec<PlacementRow>,
}

struct WorkerRow {
    name: String,
    host: String,
    pid: u32,
    version: String,
    device: String,
    offers: String,
    is_drained: bool,
    seen_at: Instant,
    task: Option<WorkersTask>,
    /// A text for a worker without a task.
    does: String,
    placement: Option<PlacementRow>,
}

/// A worker in an engine's view.
struct PlacementRow {
    worker: String,
    /// The engine, and its name for the worker.
    place: String,
    state: PlacementState,
    reason: String,
    changed_at: Instant,
}

pub async fn show(State(app): State<App>) -> Result<Response, PageError> {
    let Workers { workers, placements } = app.workers().await?;
    let page = WorkersPage {
        obstacles: app.obstacles(&workers).await?.iter().filter_map(|it| Note::new(it)).collect(),
        queue: app.queue().await?,
        workers: workers.into_iter().map(WorkerRow::from).collect(),
        placements: placements.into_iter().map(PlacementRow::from).collect(),
    };
    Ok(html(&page)?)
}

/// Pauses the queue and shows the page again.
pub async fn pause(State(app): State<App>) -> Result<Redirect, PageError> {
    app.pause_queue().await?;
    Ok(Redirect::to("/workers"))
}

/// Resumes the queue and shows the page again.
pub async fn resume(State(app): State<App>) -> Result<Redirect, PageError> {
    app.resume_queue().await?;
    Ok(Redirect::to("/workers"))
}

/// Drains a worker and shows the page again.
pub async fn drain(
    State(app): State<App>,
    InPage(Path(name)): InPage<Path<String>>,
) -> Result<Redirect, PageError> {
    app.drain_worker(&name).await?;
    Ok(Redirect::to("/workers"))
}

/// Undrains a worker and shows the page again.
pub async fn undrain(
    State(app): State<App>,
    InPage(Path(name)): InPage<Path<String>>,
) -> Result<Redirect, PageError> {
    app.undrain_worker(&name).await?;
    Ok(Redirect::to("/workers"))
}

impl From<Worker> for WorkerRow {
    fn from(worker: Worker) -> Self {
        let offers = worker.offers_in_words();
        let does = match worker.waits_for {
            _ if !worker.alive => "nothing: it has died, or hangs".to_owned(),
            _ if worker.drained_at.is_some() => "drained: it claims no task".to_owned(),
            Some(reason) => format!("waits: {reason}"),
            None => "waits for a task".to_owned(),
        };
        Self {
            offers,
            name: worker.name,
            host: worker.host,
            pid: worker.pid,
            version: worker.version,
            device: worker.device,
            is_drained: worker.drained_at.is_some(),
            seen_at: Instant::new(&worker.seen_at),
            task: worker.task.filter(|_| worker.alive),
            does,
            placement: worker.placement.map(PlacementRow::from),
        }
    }
}

impl From<Placement> for PlacementRow {
    fn from(placement: Placement) -> Self {
        let place = [Some(placement.engine), placement.identifier, placement.node];
        Self {
            worker: placement.worker,
            place: place.into_iter().flatten().collect::<Vec<_>>().join(" "),
            state: placement.state,
            reason: placement.reason.unwrap_or_default(),
            changed_at: Instant::new(&placement.changed_at),
        }
    }
}
