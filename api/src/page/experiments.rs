//! The front page: every experiment with its state, progress and main result.

use askama::Template;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use spec::JobKind;
use wire::{Job, JobState, Listed as _};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::QueryPairs;
use crate::page::answer::{PageError, html};
use crate::page::filter_query::{FilterQuery, Order};
use crate::page::labels::TagLink;
use crate::page::note::Note;
use crate::page::parts::{Commands, JobHeader};
use crate::page::rows::{Row, comparison};
use crate::page::text;

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
    /// The experiments that run or wait. A filtered list and a later page have none.
    now: Option<Now>,
    experiments: Vec<Experiment>,
    older: Option<String>,
}

/// The experiments that run or wait. They stand above those that have ended, however many wait.
struct Now {
    /// How many tasks run and wait, and where.
    sentence: String,
    /// Sentences about why experiments wait.
    obstacles: Vec<Note>,
    running: Vec<Experiment>,
    /// The waiting ones among the newest experiments, and their number in words.
    waiting: Vec<Experiment>,
    wait: String,
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
    /// The page that compares its runs, if it is a sweep.
    comparison: Option<String>,
    rows: Vec<Row>,
}

pub async fn show(
    State(app): State<App>,
    pairs: QueryPairs,
    headers: HeaderMap,
) -> Result<Response, PageError> {
    let asked = FilterQuery::new("/".to_owned(), pairs);
    let jobs = app.experiments(asked.pairs(), PAGE).await?;
    let are_final = jobs.jobs.iter().all(|job| job.state.is_final());
    let mut experiments = Experiment::of_each(&app, &jobs.jobs).await?;
    let is_first = asked.pairs().is_empty();
    let now = if is_first {
        Now::among(&app, &mut experiments, jobs.next.is_some()).await?
    } else {
        None
    };
    let (state, kind) = (asked.value("state"), asked.value("kind"));
    let choice = |known: &JobKind| Choice { kind: known.as_str(), current: kind == known.as_str() };
    let page = ExperimentsPage {
        commands: Commands::new(&headers),
        filters: filters(&asked, &state),
        text: asked.value("text"),
        tags: asked.value("tag"),
        kinds: JobKind::ALL.iter().map(choice).collect(),
        filtered: asked.is_filtered(),
        orders: asked.orders(&Job::LIST),
        sort: asked.order(),
        // An experiment that runs may be older than those of this page.
        settled: are_final && now.is_none(),
        now,
        experiments,
        older: jobs.next.map(|cursor| asked.with("cursor", Some(&cursor))),
        state,
    };
    Ok(html(&page)?)
}

impl Experiment {
    async fn of_each(app: &App, jobs: &[Job]) -> Result<Vec<Self>, ApiError> {
        let rows = Row::of_each(app, jobs).await?;
        let experiment = |(job, rows): (&Job, Vec<Row>)| Self {
            job: JobHeader::of(job),
            tags: TagLink::all(&job.tags),
            is_single: job.kind != JobKind::Pipeline,
            comparison: comparison(&rows),
            rows,
        };
        Ok(jobs.iter().zip(rows).map(experiment).collect())
    }
}

impl Now {
    /// Takes the running and waiting experiments out of the newest ones, and adds older ones that
    /// run. `None` if none runs or waits.
    async fn among(
        app: &App,
        newest: &mut Vec<Experiment>,
        has_older: bool,
    ) -> Result<Option<Self>, ApiError> {
        let is_running = [("state".to_owned(), JobState::Running.as_str().to_owned())];
        let running = app.experiments(&is_running, PAGE).await?.jobs;
        let running = Experiment::of_each(app, &running).await?;
        let (ended, open): (Vec<_>, Vec<_>) = newest.drain(..).partition(|one| one.job.settled);
        *newest = ended;
        let waiting: Vec<Experiment> =
            open.into_iter().filter(|one| one.job.state != JobState::Running).collect();
        if running.is_empty() && waiting.is_empty() {
            return Ok(None);
        }
        let (queue, workers) = (app.queue().await?, app.workers().await?.workers);
        let tasks = |count: u64, says: [&str; 2]| match count {
            1 => format!("1 task {}", says[0]),
            _ => format!("{} tasks {}", text::count(count), says[1]),
        };
        let alive = match workers.iter().filter(|worker| worker.alive).count() {
            1 => "1 worker".to_owned(),
            count => format!("{count} workers"),
        };
        let wait = match (waiting.len(), has_older) {
            (1, _) => "1 experiment waits".to_owned(),
            (count, false) => format!("{count} experiments wait"),
            (count, true) => format!("The newest {count} experiments that wait"),
        };
        Ok(Some(Self {
            sentence: format!(
                "{}, {} · {alive} · {} free",
                tasks(queue.running, ["runs", "run"]),
                tasks(queue.queued, ["waits", "wait"]),
                text::size(app.free_bytes()?),
            ),
            obstacles: app
                .obstacles(&workers)
                .await?
                .iter()
                .filter_map(|it| Note::new(it))
                .collect(),
            running,
            waiting,
            wait,
        }))
    }
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
