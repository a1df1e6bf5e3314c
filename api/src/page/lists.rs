//! The lists of datasets, runs, checkpoints and evaluations, each with a filter and page by page.

use askama::Template;
use axum::extract::State;
use axum::response::Response;
use spec::ValidationMetric;
use wire::{Checkpoint, Dataset, DatasetState, Evaluation, Job, JobState, List, Listed as _, Run};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;
use crate::extract::QueryPairs;
use crate::page::answer::{PageError, html};
use crate::page::checkpoint::marks;
use crate::page::dataset::filling;
use crate::page::filter_query::FilterQuery;
use crate::page::kinds::{evaluation_headlines, own_page};
use crate::page::text;

/// A list of the page: its title, and the columns that follow the name.
struct Listed {
    path: &'static str,
    title: &'static str,
    /// Said where there is nothing.
    empty: &'static str,
    columns: &'static [ListColumn],
}

struct ListColumn {
    heading: &'static str,
    is_number: bool,
}

const fn words(heading: &'static str) -> ListColumn {
    ListColumn { heading, is_number: false }
}

const fn number(heading: &'static str) -> ListColumn {
    ListColumn { heading, is_number: true }
}

static OF_DATASETS: Listed = Listed {
    path: "/datasets",
    title: "Datasets",
    empty: "A simulation or an import makes a dataset.",
    columns: &[
        words("State"),
        number("Trajectories"),
        number("Samples"),
        number("Size"),
        words("Created"),
    ],
};

static OF_RUNS: Listed = Listed {
    path: "/runs",
    title: "Runs",
    empty: "A training, an evaluation or a control job makes a run.",
    columns: &[words("Kind"), words("State"), number("Validation RMSE, °"), words("Created")],
};

static OF_CHECKPOINTS: Listed = Listed {
    path: "/checkpoints",
    title: "Checkpoints",
    empty: "A training writes checkpoints.",
    columns: &[
        words("Model"),
        number("Step"),
        words("Mark"),
        number("Validation RMSE, °"),
        number("Size"),
        words("Created"),
    ],
};

static OF_EVALUATIONS: Listed = Listed {
    path: "/evaluations",
    title: "Evaluations",
    empty: "An evaluation compares checkpoints and baselines on the same scenarios.",
    columns: &[words("State"), words("Mean RMSE"), words("Created")],
};

#[derive(Template)]
#[template(path = "list.html")]
struct ListPage {
    list: &'static Listed,
    text: String,
    tags: String,
    filtered: bool,
    rows: Vec<ListRow>,
    older: Option<String>,
}

struct ListRow {
    href: String,
    name: String,
    /// A text that tells the item from others of the same name.
    remark: String,
    tags: Vec<String>,
    cells: Vec<(&'static ListColumn, ListCell)>,
}

enum ListCell {
    Text(String),
    /// The state of a job, by which it is coloured, and the words for it.
    State(JobState, String),
}

pub async fn datasets(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let asked = FilterQuery::new("/datasets", pairs);
    let found = app.datasets(&asked.request(&Dataset::LIST)?).await?;
    let abandoned =
        found.datasets.iter().filter(|dataset| dataset.state == DatasetState::Abandoned);
    let jobs = app.jobs_by_id(&abandoned.map(|dataset| dataset.job).collect::<Vec<_>>()).await?;
    let rows =
        found.datasets.iter().map(|dataset| of_dataset(dataset, jobs.get(&dataset.job))).collect();
    answer(&OF_DATASETS, &asked, rows, found.next)
}

pub async fn runs(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let asked = FilterQuery::new("/runs", pairs);
    let found = app.runs(&asked.request(&Run::LIST)?).await?;
    answer(&OF_RUNS, &asked, found.runs.iter().map(of_run).collect(), found.next)
}

pub async fn checkpoints(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let asked = FilterQuery::new("/checkpoints", pairs);
    let found = app.checkpoints(&asked.request(&Checkpoint::LIST)?).await?;
    let jobs: Vec<i64> = found.checkpoints.iter().map(|checkpoint| checkpoint.job).collect();
    let jobs = app.jobs_by_id(&jobs).await?;
    let row = |checkpoint: &Checkpoint| {
        let training = jobs.get(&checkpoint.job).map_or("", |job| job.name.as_str());
        of_checkpoint(checkpoint, training)
    };
    let rows = found.checkpoints.iter().map(row).collect();
    answer(&OF_CHECKPOINTS, &asked, rows, found.next)
}

pub async fn evaluations(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let asked = FilterQuery::new("/evaluations", pairs);
    let found = app.evaluations(&asked.request(&Evaluation::LIST)?).await?;
    let listed: Vec<(i64, i64)> =
        found.evaluations.iter().map(|evaluation| (evaluation.id, evaluation.run)).collect();
    let headlines = evaluation_headlines(&app, &listed).await?;
    let row = |evaluation: &Evaluation| {
        of_evaluation(evaluation, headlines.get(&evaluation.id).cloned().unwrap_or_default())
    };
    let rows = found.evaluations.iter().map(row).collect();
    answer(&OF_EVALUATIONS, &asked, rows, found.next)
}

fn answer(
    list: &'static Listed,
    asked: &FilterQuery,
    rows: Vec<ListRow>,
    next: Option<String>,
) -> Result<Response, PageError> {
    let page = ListPage {
        list,
        text: asked.value("text"),
        tags: asked.value("tag"),
        filtered: !asked.is_empty(),
        rows,
        older: next.map(|cursor| asked.with("cursor", Some(&cursor))),
    };
    Ok(html(&page)?)
}

impl FilterQuery {
    fn request(&self, list: &'static List) -> Result<ListRequest, ApiError> {
        ListRequest::read(list, self.pairs())
    }
}

impl Listed {
    fn row(&'static self, href: String, name: &str, cells: Vec<ListCell>) -> ListRow {
        ListRow {
            href,
            name: name.to_owned(),
            remark: String::new(),
            tags: Vec::new(),
            cells: self.columns.iter().zip(cells).collect(),
        }
    }
}

/// `job` is the job of a dataset that will never be complete.
fn of_dataset(dataset: &Dataset, job: Option<&Job>) -> ListRow {
    let state = match (dataset.state, job) {
        (DatasetState::Complete, _) => ListCell::State(JobState::Succeeded, "complete".to_owned()),
        (DatasetState::Building, _) => ListCell::State(JobState::Running, "in progress".to_owned()),
        (DatasetState::Abandoned, Some(job)) => {
            ListCell::State(job.state, format!("{} {}", filling(job.kind), job.state))
        }
        (DatasetState::Abandoned, None) => {
            ListCell::State(JobState::Failed, "incomplete".to_owned())
        }
    };
    let cells = vec![
        state,
        ListCell::Text(text::count(dataset.trajectories)),
        ListCell::Text(text::count(dataset.samples.into())),
        ListCell::Text(text::size(dataset.bytes)),
        created(&dataset.created_at),
    ];
    let row = OF_DATASETS.row(format!("/datasets/{}", dataset.id), &dataset.name, cells);
    ListRow { remark: dataset.id.to_string(), tags: both(&dataset.tags, &dataset.job_tags), ..row }
}

fn of_run(run: &Run) -> ListRow {
    let rmse_deg = run.metrics.get(ValidationMetric::RmseDeg.key()).and_then(|metric| metric.value);
    let cells = vec![
        ListCell::Text(run.kind.to_string()),
        state(run.state),
        ListCell::Text(rmse_deg.map_or(String::new(), text::degrees)),
        created(&run.created_at),
    ];
    let page = own_page(run.kind, run.job, run.id).map(|link| link.href);
    let href = page.unwrap_or_else(|| format!("/jobs/{}", run.job));
    let row = OF_RUNS.row(href, &run.name, cells);
    ListRow { remark: run.id.to_string(), tags: both(&run.tags, &run.job_tags), ..row }
}

fn of_checkpoint(checkpoint: &Checkpoint, training: &str) -> ListRow {
    let rmse_deg = checkpoint.metrics.get(ValidationMetric::RmseDeg.key());
    let cells = vec![
        ListCell::Text(checkpoint.architecture.clone()),
        ListCell::Text(text::count(checkpoint.step)),
        ListCell::Text(marks(checkpoint)),
        ListCell::Text(rmse_deg.map_or(String::new(), |value| text::degrees(*value))),
        ListCell::Text(text::size(checkpoint.files.iter().map(|file| file.size).sum())),
        created(&checkpoint.created_at),
    ];
    let name = checkpoint.name.as_deref().unwrap_or(training);
    let row = OF_CHECKPOINTS.row(format!("/checkpoints/{}", checkpoint.id), name, cells);
    let tags = both(&checkpoint.tags, &checkpoint.job_tags);
    ListRow { remark: checkpoint.id.to_string(), tags, ..row }
}

fn of_evaluation(evaluation: &Evaluation, headline: String) -> ListRow {
    let cells =
        vec![state(evaluation.state), ListCell::Text(headline), created(&evaluation.created_at)];
    let href = format!("/evaluations/{}", evaluation.id);
    let row = OF_EVALUATIONS.row(href, &evaluation.name, cells);
    ListRow { remark: evaluation.id.to_string(), tags: evaluation.tags.clone(), ..row }
}

fn state(state: JobState) -> ListCell {
    ListCell::State(state, state.to_string())
}

fn created(at: &str) -> ListCell {
    ListCell::Text(text::instant(at))
}

/// The tags of a thing and of its job.
fn both(own: &[String], job: &[String]) -> Vec<String> {
    own.iter().chain(job).cloned().collect()
}
