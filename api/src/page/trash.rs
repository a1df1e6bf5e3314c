//! Pages for deleting things, which show what depends on them, and for the trash.

use askama::Template;
use axum::extract::State;
use axum::response::{Redirect, Response};
use axum::routing::{MethodRouter, get, post};
use serde::Deserialize;
use spec::ValidationMetric;
use store::{Respect, StoreError};
use wire::{Checkpoint, Dependents, ItemKind, Trash, TrashedItem};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::limits::PAGE_DEFAULT;
use crate::page::answer::{InPage, PageError, html};
use crate::page::instant::Instant;
use crate::page::lists::Paged as _;
use crate::page::text;

#[derive(Template)]
#[template(path = "delete.html")]
struct DeletePage {
    kind: ItemKind,
    id: i64,
    /// The names that people know it by.
    called: Called,
    size: String,
    along: Vec<Along>,
    along_left_out: usize,
    jobs: Vec<DependentRow>,
    jobs_left_out: usize,
    /// Whether a job that has not ended prevents the deletion.
    is_kept: bool,
    days: u64,
}

/// The name of an item, and more words about it.
#[derive(Default)]
struct Called {
    /// The address of its page; empty for an item in the trash.
    href: String,
    /// The name that people know it by, which an item in the trash has, too.
    name: String,
    aliases: Vec<String>,
    /// The kind of thing, such as `training` or `lagrangian, step 360`.
    about: String,
}

/// An item that is deleted along with another.
struct Along {
    words: String,
    called: Called,
}

struct DependentRow {
    id: i64,
    name: String,
    state: wire::JobState,
    relation: &'static str,
}

#[derive(Template)]
#[template(path = "trash.html")]
struct TrashPage {
    rows: Vec<TrashedRow>,
    next: Option<String>,
}

struct TrashedRow {
    kind: ItemKind,
    id: i64,
    name: String,
    /// The name that people gave the result of a job; empty without one.
    result: String,
    size: String,
    deleted_at: Instant,
    purge_at: Instant,
    reason: String,
}

#[derive(Deserialize)]
pub struct Force {
    #[serde(default)]
    force: bool,
}

#[derive(Deserialize)]
pub struct TrashQuery {
    before: Option<String>,
}

/// Number of things listed on the page of a deletion. The others are counted.
const ALONG: usize = 20;

/// The page with the question whether to delete a thing of this kind, and the form that deletes it.
pub fn deletion(kind: ItemKind) -> MethodRouter<App> {
    let ask = async move |State(app): State<App>, InPage(Path(id)): InPage<Path<i64>>| {
        let found = app.dependents(kind, id).await?;
        let days = app.options().keep_deleted.as_secs() / (24 * 60 * 60);
        Ok::<Response, PageError>(html(&page(&app, &found, days).await?)?)
    };
    let delete =
        async move |State(app): State<App>,
                    InPage(Path(id)): InPage<Path<i64>>,
                    InPage(Query(Force { force })): InPage<Query<Force>>| {
            let respect = if force { Respect::Open } else { Respect::All };
            app.delete(kind, id, respect).await?;
            Ok::<Redirect, PageError>(Redirect::to("/trash"))
        };
    get(ask).post(delete)
}

/// The form that restores a thing of this kind and shows it.
pub fn restoration(kind: ItemKind) -> MethodRouter<App> {
    let restore = async move |State(app): State<App>, InPage(Path(id)): InPage<Path<i64>>| {
        app.restore(kind, id).await?;
        Ok::<Redirect, PageError>(Redirect::to(&format!("/{kind}s/{id}")))
    };
    post(restore)
}

/// The things in the trash.
pub async fn show(
    State(app): State<App>,
    InPage(Query(TrashQuery { before })): InPage<Query<TrashQuery>>,
) -> Result<Response, PageError> {
    let Trash { items, next } = app.trash(PAGE_DEFAULT, before.as_deref()).await?;
    Ok(html(&TrashPage { rows: items.into_iter().map(TrashedRow::from).collect(), next })?)
}

impl Called {
    /// The name alone of an item that is in the trash itself.
    async fn of(app: &App, kind: ItemKind, id: i64) -> Result<Self, ApiError> {
        let name = app.name_of(kind, id).await?;
        match Self::of_kept(app, kind, id).await {
            Err(ApiError::Store(StoreError::InTrash { .. } | StoreError::OwnerDeleted { .. })) => {
                Ok(Self { name, ..Self::default() })
            }
            Ok(called) => Ok(Self { name, ..called }),
            Err(error) => Err(error),
        }
    }

    /// Everything but the name.
    async fn of_kept(app: &App, kind: ItemKind, id: i64) -> Result<Self, ApiError> {
        let href = format!("/{kind}s/{id}");
        Ok(match kind {
            ItemKind::Job => {
                let job = app.job(id).await?;
                let about = match job.members.len() {
                    0 => job.kind.to_string(),
                    members => format!("{} of {}", job.kind, text::counted(members, "job")),
                };
                Self { href, about, ..Self::default() }
            }
            ItemKind::Run => {
                let run = app.run(id).await?;
                Self { href: run.href(), about: run.kind.to_string(), ..Self::default() }
            }
            ItemKind::Dataset => {
                let dataset = app.dataset(id).await?;
                let about = text::counted(dataset.trajectories, "trajectory");
                Self { href, about, ..Self::default() }
            }
            ItemKind::Checkpoint => {
                let Checkpoint { aliases, architecture, step, metrics, .. } =
                    app.checkpoint(id).await?;
                let rmse_deg = metrics.get(ValidationMetric::RmseDeg.key());
                let rmse = rmse_deg.map(|rmse| format!(", {}°", text::degrees(*rmse)));
                let step = text::count(step);
                let about = format!("{architecture}, step {step}{}", rmse.unwrap_or_default());
                Self { href, aliases, about, ..Self::default() }
            }
        })
    }
}

async fn page(app: &App, found: &Dependents, days: u64) -> Result<DeletePage, ApiError> {
    let mut along = Vec::new();
    for item in found.along.iter().take(ALONG) {
        along.push(Along {
            words: format!("{} {}", item.kind, item.id),
            called: Called::of(app, item.kind, item.id).await?,
        });
    }
    let row = |job: &wire::Dependent| DependentRow {
        id: job.id,
        name: job.name.clone(),
        state: job.state,
        relation: job.relation.phrase(),
    };
    let is_open = |job: &&wire::Dependent| !job.state.is_final();
    let open = found.jobs.iter().filter(is_open);
    let ended = found.jobs.iter().filter(|job| !is_open(job));
    Ok(DeletePage {
        kind: found.kind,
        id: found.id,
        called: Called::of(app, found.kind, found.id).await?,
        size: text::size(found.bytes),
        along,
        along_left_out: found.along.len().saturating_sub(ALONG),
        // Those that prevent the deletion come first.
        jobs: open.chain(ended).take(ALONG).map(row).collect(),
        jobs_left_out: found.jobs.len().saturating_sub(ALONG),
        is_kept: found.jobs.iter().any(|job| !job.state.is_final()),
        days,
    })
}

impl From<TrashedItem> for TrashedRow {
    fn from(item: TrashedItem) -> Self {
        Self {
            kind: item.kind,
            id: item.id,
            name: item.name,
            result: item.result_name.unwrap_or_default(),
            size: text::size(item.bytes),
            deleted_at: Instant::new(&item.deleted_at),
            purge_at: Instant::new(&item.purge_at),
            reason: item.reason.unwrap_or_default(),
        }
    }
}
