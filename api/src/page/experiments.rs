//! The front page: every experiment with its state, progress and key result.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;
use spec::JobKind;
use wire::JobState;

use crate::app::App;
use crate::extract::Query;
use crate::page::answer::{InPage, PageError, html};
use crate::page::parts::{Commands, Standing};
use crate::page::rows::Row;

/// Experiments of one page; each shows all its jobs.
const PAGE: u32 = 20;

#[derive(Deserialize)]
pub struct Listing {
    state: Option<JobState>,
    before: Option<i64>,
}

#[derive(Template)]
#[template(path = "experiments.html")]
struct ExperimentsPage {
    commands: Commands,
    filters: Vec<Filter>,
    filtered: bool,
    settled: bool,
    /// Why experiments wait.
    obstacles: Vec<String>,
    experiments: Vec<Experiment>,
    older: Option<String>,
}

struct Filter {
    href: String,
    label: &'static str,
    current: bool,
}

struct Experiment {
    job: Standing,
    /// Its only row says the same as its heading.
    is_single: bool,
    rows: Vec<Row>,
}

pub async fn show(
    State(app): State<App>,
    InPage(Query(listing)): InPage<Query<Listing>>,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let jobs = app.experiments(listing.state, listing.before, PAGE).await?;
    let rows = Row::of_each(&app, &jobs.jobs).await?;
    let experiments = jobs.jobs.iter().zip(rows).map(|(job, rows)| Experiment {
        job: Standing::of(job),
        is_single: job.kind != JobKind::Pipeline,
        rows,
    });
    let settled = jobs.jobs.iter().all(|job| job.state.is_final());
    let obstacles =
        if settled { Vec::new() } else { app.obstacles(&app.workers().await?.workers).await? };
    let page = ExperimentsPage {
        obstacles,
        commands: Commands::new(&headers),
        filters: filters(listing.state),
        filtered: listing.state.is_some() || listing.before.is_some(),
        settled,
        experiments: experiments.collect(),
        older: jobs.next.map(|before| match listing.state {
            Some(state) => format!("/?state={state}&before={before}"),
            None => format!("/?before={before}"),
        }),
    };
    Ok(html(&page)?)
}

fn filters(current: Option<JobState>) -> Vec<Filter> {
    let states = [
        JobState::Running,
        JobState::Queued,
        JobState::Succeeded,
        JobState::Failed,
        JobState::Cancelled,
    ];
    let of_state = states.map(|state| Filter {
        href: format!("/?state={state}"),
        label: state.as_str(),
        current: current == Some(state),
    });
    let all = Filter { href: "/".to_owned(), label: "all", current: current.is_none() };
    [all].into_iter().chain(of_state).collect()
}
