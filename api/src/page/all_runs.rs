//! The list of all runs: those of torqued and those that clients of MLflow logged, with a filter, an order and columns over
//! any metric and parameter.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use askama::Template;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use store::ExperimentId;
use wire::JobState;

use crate::app::App;
use crate::app::mlflow::{RunName, RunSearch};
use crate::extract::QueryPairs;
use crate::limits::LISTED_COLUMNS;
use crate::mlflow::entities::{Run, View};
use crate::mlflow::filter::Filter;
use crate::mlflow::order::Order;
use crate::mlflow::{Attribute, MlflowError};
use crate::page::answer::{PageError, html};
use crate::page::compare::main_keys;
use crate::page::filter_query::FilterQuery;
use crate::page::instant::Instant;
use crate::page::kinds::own_page;
use crate::page::lists::suggested;
use crate::page::logged::state;
use crate::page::text;

/// Runs on a page.
const RUNS: u32 = 100;

/// Columns of a list whose reader chose none.
const USUAL_COLUMNS: usize = 4;

#[derive(Template)]
#[template(path = "all_runs.html")]
struct AllRunsPage {
    filter: String,
    order: String,
    chosen: String,
    /// Why the filter or the order is refused; empty if it is not.
    problem: String,
    columns: Vec<Column>,
    /// The values that the field of columns may get: the chosen columns, and one more that a run of the page has.
    suggested: Vec<String>,
    /// Chosen columns that no run of the page has.
    unknown: Vec<String>,
    rows: Vec<Row>,
    next: Option<String>,
}

/// A metric or a parameter as a column, with a link that sorts by it.
struct Column {
    name: String,
    href: String,
    /// The direction of the present order; empty if it is by something else.
    mark: &'static str,
}

struct Row {
    href: String,
    /// The name by which the comparison knows it.
    compared: String,
    name: String,
    experiment: String,
    state: JobState,
    began: Option<Instant>,
    cells: Vec<String>,
}

pub async fn show(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let asked = FilterQuery::new("/logged".to_owned(), pairs);
    let found = match search(&app, &asked).await {
        Ok(found) => found,
        Err(MlflowError::Refused { message, .. }) => {
            let page = AllRunsPage { problem: message, ..AllRunsPage::new(&asked) };
            return Ok((StatusCode::BAD_REQUEST, html(&page)?).into_response());
        }
        Err(MlflowError::Api(error)) => return Err(error.into()),
    };
    let chosen = asked.value("columns");
    let chosen: Vec<String> = chosen.split([' ', ',']).map(str::to_owned).collect();
    let mut names: Vec<String> = chosen.into_iter().filter(|name| !name.is_empty()).collect();
    names.truncate(LISTED_COLUMNS);
    let known = known_columns(&found.runs);
    let unknown = names.iter().filter(|name| !found.runs.is_empty() && !known.contains(*name));
    let unknown = unknown.cloned().collect();
    let chosen: Vec<&str> = names.iter().map(String::as_str).collect();
    let suggested = suggested(&chosen, &known);
    if names.is_empty() {
        names = usual_columns(&found.runs);
    }
    let order = asked.value("order");
    let column = |name: &String| {
        let is_metric = found.runs.iter().any(|run| metric(run, name).is_some());
        let field = format!("{}.`{name}`", if is_metric { "metrics" } else { "params" });
        let [rising, falling] = ["ASC", "DESC"].map(|direction| format!("{field} {direction}"));
        let mark = match order.as_str() {
            order if order == rising => "\u{2191}",
            order if order == falling => "\u{2193}",
            _ => "",
        };
        let next = if order == rising { falling } else { rising };
        Column { name: name.clone(), href: asked.with("order", Some(&next)), mark }
    };
    let page = AllRunsPage {
        columns: names.iter().map(column).collect(),
        suggested,
        unknown,
        rows: found.runs.iter().map(|run| Row::of(run, &found.experiments, &names)).collect(),
        next: found.next.map(|next| asked.with("cursor", Some(&next))),
        ..AllRunsPage::new(&asked)
    };
    Ok(html(&page)?)
}

struct Found {
    runs: Vec<Run>,
    /// The names of experiments.
    experiments: HashMap<String, String>,
    next: Option<String>,
}

async fn search(app: &App, asked: &FilterQuery) -> Result<Found, MlflowError> {
    let experiments = app.experiment_names().await?;
    let (filter, order) = (asked.value("filter"), asked.value("order"));
    let newest = filter.is_empty() && order.is_empty();
    let order = if order.is_empty() { "start_time DESC" } else { &order };
    let search = RunSearch {
        experiments: experiments.keys().copied().collect(),
        filter: Filter::parse(&filter, &Attribute::OF_RUNS)?,
        orders: vec![Order::parse(order, &Attribute::OF_RUNS)?],
        view: View::Active,
        limit: RUNS,
        skipped: asked.value("cursor").parse().unwrap_or(0),
        newest,
    };
    let (runs, next) = app.search_runs(&search).await?;
    let named = |(id, name): (ExperimentId, String)| (id.to_string(), name);
    Ok(Found { runs, experiments: experiments.into_iter().map(named).collect(), next })
}

/// The metrics and parameters of these runs.
fn known_columns(runs: &[Run]) -> BTreeSet<String> {
    let of_run = |run: &Run| {
        let metrics = run.data.metrics.iter().map(|metric| metric.key.clone());
        let params = run.data.params.iter().map(|param| param.key.clone());
        metrics.chain(params).collect::<Vec<_>>()
    };
    runs.iter().flat_map(of_run).collect()
}

/// The metrics that say how good models are, and those that most of the runs have.
fn usual_columns(runs: &[Run]) -> Vec<String> {
    let mut counts: BTreeMap<&String, usize> = BTreeMap::new();
    for metric in runs.iter().flat_map(|run| &run.data.metrics) {
        *counts.entry(&metric.key).or_default() += 1;
    }
    let main = main_keys(&counts.keys().copied().collect());
    let mut others: Vec<(&String, usize)> = counts.into_iter().collect();
    others.retain(|(key, _)| !main.contains(key));
    others.sort_by_key(|(_, count)| usize::MAX - count);
    let others = others.into_iter().map(|(key, _)| key.clone());
    main.into_iter().chain(others).take(USUAL_COLUMNS).collect()
}

fn metric(run: &Run, name: &str) -> Option<f64> {
    run.data.metrics.iter().find(|metric| metric.key == name).map(|metric| metric.value)
}

impl AllRunsPage {
    fn new(asked: &FilterQuery) -> Self {
        Self {
            filter: asked.value("filter"),
            order: asked.value("order"),
            chosen: asked.value("columns"),
            problem: String::new(),
            columns: Vec::new(),
            suggested: Vec::new(),
            unknown: Vec::new(),
            rows: Vec::new(),
            next: None,
        }
    }
}

/// The page that shows a run of torqued, which says its kind and its job in tags.
fn own_href(run: &Run, id: i64) -> String {
    let tag = |key: &str| {
        let tag = run.data.tags.iter().find(|tag| tag.key == key);
        tag.map_or("", |tag| tag.value.as_str())
    };
    let job = tag("torqued.job");
    match (tag("torqued.kind").parse(), job.parse()) {
        (Ok(kind), Ok(number)) => own_page(kind, number, id).map(|link| link.href),
        _ => None,
    }
    .unwrap_or_else(|| format!("/jobs/{job}"))
}

impl Row {
    fn of(run: &Run, experiments: &HashMap<String, String>, columns: &[String]) -> Self {
        let (href, compared) = match RunName::parse(&run.info.run_id) {
            RunName::Own(id) => (own_href(run, id.0), id.to_string()),
            RunName::Tracked(identifier) => (format!("/logged/{identifier}"), identifier),
        };
        let cell = |name: &String| match metric(run, name) {
            Some(value) => text::value(value),
            None => {
                let param = run.data.params.iter().find(|param| param.key == *name);
                param.map(|param| text::shortened(&param.value, 40)).unwrap_or_default()
            }
        };
        Self {
            href,
            compared,
            name: run.info.run_name.clone(),
            experiment: experiments.get(&run.info.experiment_id).cloned().unwrap_or_default(),
            state: state(run.info.status),
            began: Instant::of_milliseconds(run.info.start_time),
            cells: columns.iter().map(cell).collect(),
        }
    }
}
