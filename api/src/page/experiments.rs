//! The front page: every experiment with its state, progress and main result.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use spec::JobKind;
use wire::{Job, JobState, Listed as _};

use crate::app::App;
use crate::extract::QueryPairs;
use crate::page::answer::{PageError, html};
use crate::page::filter_query::{FilterQuery, Order};
use crate::page::labels::TagLink;
use crate::page::parts::{Commands, JobHeader};
use crate::page::rows::Row;

/// Number of experiments on a page. Each shows all its jobs.
const PAGE: u32 = 20;

#[derive(Template)]
#[template(path = "experiments.html")]
struct ExperimentsPage {
    commands: Commands,
    filters: Vec<Filter>,
    /// The fields of the form, as the user filled them in.
    text: String,
    tags: String,
    state: String,
    kinds: Vec<Choice>,
    filtered: bool,
    sort: String,
    orders: Vec<Order>,
    settled: bool,
    /// Sentences about why experiments wait.
    obstacles: Vec<String>,
    experiments: Vec<Experiment>,
    older: Option<String>,
}

struct Filter {
    href: String,
    label: &'static str,
    current: bool,
}

struct Choice {
    kind: &'static str,
    current: bool,
}

struct Experiment {
    job: JobHeader,
    tags: Vec<TagLink>,
    /// Whether its only row repeats its heading.
    is_single: bool,
    rows: Vec<Row>,
}

pub async fn show(
    State(app): State<App>,
    pairs: QueryPairs,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let asked = FilterQuery::new("/".to_owned(), pairs);
    let jobs = app.experiments(asked.pairs(), PAGE).await?;
    let rows = Row::of_each(&app, &jobs.jobs).await?;
    let experiments = jobs.jobs.iter().zip(rows).map(|(job, rows)| Experiment {
        job: JobHeader::of(job),
        tags: TagLink::all(&job.tags),
        is_single: job.kind != JobKind::Pipeline,
        rows,
    });
    let settled = jobs.jobs.iter().all(|job| job.state.is_final());
    let obstacles =
        if settled { Vec::new() } else { app.obstacles(&app.workers().await?.workers).await? };
    let (state, kind) = (asked.value("state"), asked.value("kind"));
    let choice = |known: &JobKind| Choice { kind: known.as_str(), current: kind == known.as_str() };
    let page = ExperimentsPage {
        obstacles,
        commands: Commands::new(&headers),
        filters: filters(&asked, &state),
        text: asked.value("text"),
        tags: asked.value("tag"),
        kinds: JobKind::ALL.iter().map(choice).collect(),
        filtered: asked.is_filtered(),
        orders: asked.orders(&Job::LIST),
        sort: asked.order(),
        settled,
        experiments: experiments.collect(),
        older: jobs.next.map(|cursor| asked.with("cursor", Some(&cursor))),
        state,
    };
    Ok(html(&page)?)
}

fn filters(asked: &FilterQuery, current: &str) -> Vec<Filter> {
    let states = [
        JobState::Running,
        JobState::Queued,
        JobState::Succeeded,
        JobState::Failed,
        JobState::Cancelled,
    ];
    let of_state = states.map(|state| Filter {
        href: asked.with("state", Some(state.as_str())),
        label: state.as_str(),
        current: current == state.as_str(),
    });
    let all = Filter { href: asked.with("state", None), label: "all", current: current.is_empty() };
    [all].into_iter().chain(of_state).collect()
}
