//! The page that shows several runs beside each other.

use std::collections::BTreeSet;
use std::mem;

use askama::Template;
use axum::extract::State;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::response::{IntoResponse as _, Response};
use reports::Table;
use reports::comparison::{self, Compared};
use spec::ValidationMetric;
use store::StoreError;
use wire::RunName;

use crate::app::App;
use crate::app::compared::ComparedRun;
use crate::charts::{self, Over, Overlaid, Scattered, overlaid};
use crate::error::ApiError;
use crate::extract::QueryPairs;
use crate::limits::COMPARED_RUNS;
use crate::page::answer::{PageError, html};
use crate::page::lists::CSV;
use crate::page::parts::Link;
use crate::page::text;

/// The size of one metric of several.
const PANEL: figures::Size = figures::Size { width: 760, height: 300 };

#[derive(Template)]
#[template(path = "compare.html")]
struct ComparePage {
    links: Vec<Link>,
    /// Runs in the trash, which are left out.
    trashed: Vec<i64>,
    names: Vec<RunName>,
    /// The keys of all metrics, and whether each is drawn.
    keys: Vec<(String, bool)>,
    over: Over,
    smoothing: f64,
    all: bool,
    figure: Option<String>,
    /// The fields that differ, and whether curves are grouped by each.
    groups: Vec<(String, bool)>,
    /// The numbers that differ, and whether each is drawn.
    numbers: Vec<(String, bool)>,
    /// The metric over one of them.
    scatter: Option<String>,
    tables: Vec<Table>,
    /// The address of the tables as CSV.
    csv: String,
    /// Whether all runs have ended.
    settled: bool,
}

/// The query of the page.
struct Asked {
    runs: Vec<RunName>,
    metric: Option<String>,
    over: Over,
    /// The weight of what came before, below 1.
    smoothing: f64,
    /// Whether parameters are shown that all runs share.
    all: bool,
    /// The parameter over which the metric is drawn.
    against: Option<String>,
    /// The field by whose values curves are grouped.
    group: Option<String>,
    /// Whether the tables are asked for, as a file.
    is_csv: bool,
}

/// Runs that stand beside each other, each in a column. More of them stand in rows, if parameters
/// are fewer.
const COLUMNS: usize = 6;

pub async fn show(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let pairs = pairs.filled();
    let mut asked = Asked::read(&pairs)?;
    let mut found: Vec<ComparedRun> = Vec::with_capacity(asked.runs.len());
    let mut trashed = Vec::new();
    for name in &asked.runs {
        match app.compared_run(name).await {
            Ok(run) => found.push(run),
            // The others can still be compared.
            Err(ApiError::Store(StoreError::InTrash { item, .. })) => trashed.push(item.id),
            Err(error) => return Err(error.into()),
        }
    }
    let is_there = |name: &RunName| !matches!(name, RunName::Own(id) if trashed.contains(id));
    asked.runs.retain(is_there);
    let runs: Vec<Compared> = found.iter().map(|run| run.compared.clone()).collect();
    if asked.is_csv {
        return as_csv(&tables(&runs, asked.all));
    }
    let named = app.with_names(&runs).await?;
    let keys: BTreeSet<&String> = runs.iter().flat_map(|run| run.metrics.keys()).collect();
    let drawn: Vec<String> = match &asked.metric {
        Some(key) => vec![key.clone()],
        None => main_keys(&keys),
    };
    let fields = comparison::differing(&runs);
    let field = asked.group.filter(|field| fields.contains(field));
    let groups = match &field {
        None => comparison::repetitions(&runs),
        Some(field) => comparison::sharing(&runs, field),
    };
    let name_of = |places: &[usize]| match &field {
        None => name_of_seeds(&runs, places),
        Some(field) => name_of_group(&named, places, field),
    };
    let mut panels = Vec::new();
    for key in &drawn {
        let mut all = app.compared_curves(&found, key).await?;
        let group = |places: &Vec<usize>| Overlaid {
            name: name_of(places),
            curves: places.iter().map(|&place| mem::take(&mut all[place])).collect(),
        };
        let curves: Vec<Overlaid> = groups.iter().map(group).collect();
        panels.push(overlaid(key, asked.over, asked.smoothing, &curves));
    }
    let figure = match &panels[..] {
        [] => None,
        [only] => Some(only.to_svg(figures::Size::PAGE)?),
        several => Some(figures::stacked("The main metrics of the runs", several, PANEL)?),
    };
    let key = drawn.first();
    let numbers = comparison::numbers(&runs);
    let against = asked.against.filter(|name| numbers.contains_key(name));
    let against = against.or_else(|| numbers.keys().next().cloned());
    let scatter = match (&against, key) {
        (Some(name), Some(key)) => {
            let points = runs.iter().zip(&numbers[name]).enumerate();
            let points = points.map(|(place, (run, number))| Scattered {
                name: run.label.clone(),
                // The colour of its curve.
                colour: groups.iter().position(|group| group.contains(&place)).unwrap_or(place),
                at: *number,
                value: run.metrics.get(key).copied().flatten(),
            });
            let points: Vec<Scattered> = points.collect();
            Some(charts::scatter(name, key, &points).to_svg(figures::Size::PAGE)?)
        }
        _ => None,
    };
    let page = ComparePage {
        groups: fields.iter().map(|name| (name.clone(), Some(name) == field.as_ref())).collect(),
        scatter,
        numbers: numbers
            .keys()
            .map(|name| (name.clone(), Some(name) == against.as_ref()))
            .collect(),
        trashed,
        links: found.iter().map(|run| Link::new(&run.href, &run.compared.label)).collect(),
        names: asked.runs,
        keys: keys
            .iter()
            .map(|&known| (known.clone(), asked.metric.as_ref() == Some(known)))
            .collect(),
        over: asked.over,
        smoothing: asked.smoothing,
        all: asked.all,
        figure,
        csv: csv_address(&pairs),
        settled: found.iter().all(|run| run.has_ended),
        tables: tables(&named, asked.all).into_iter().map(|table| legible(table, &runs)).collect(),
    };
    Ok(html(&page)?)
}

/// The metrics and the parameters, without tables that have no rows.
fn tables(runs: &[Compared], all: bool) -> Vec<Table> {
    let tables = [comparison::metrics(runs), comparison::parameters(runs, all)];
    tables.into_iter().filter(|table| !table.rows.is_empty()).collect()
}

/// A table that is no wider than it needs to be.
fn legible(table: Table, runs: &[Compared]) -> Table {
    let is_wide = runs.len() > COLUMNS && table.rows.len() < runs.len();
    if is_wide { table.transposed("run") } else { table }
}

/// The same text that `torqued compare --csv` prints.
fn as_csv(tables: &[Table]) -> Result<Response, PageError> {
    let csv: Result<Vec<String>, _> = tables.iter().map(Table::to_csv).collect();
    let csv = csv.map_err(|_| ApiError::Internal)?.concat();
    let name = "attachment; filename=\"comparison.csv\"";
    Ok(([(CONTENT_TYPE, "text/csv; charset=utf-8"), (CONTENT_DISPOSITION, name)], csv)
        .into_response())
}

fn csv_address(pairs: &[(String, String)]) -> String {
    let mut query = form_urlencoded::Serializer::new(String::new());
    query.extend_pairs(pairs.iter().filter(|(name, _)| name == "run" || name == "all"));
    query.append_pair("format", CSV);
    format!("/compare?{}", query.finish())
}

/// The name of the mean of runs that share a field's value.
fn name_of_group(runs: &[Compared], places: &[usize], field: &str) -> String {
    let value = comparison::value(&runs[places[0]], field);
    let value = value.map_or_else(|| format!("no {field}"), |value| format!("{field} {value}"));
    match places.len() {
        1 => value,
        several => format!("{value}, mean of {several} runs"),
    }
}

/// Runs of a curve that its name has the ids of.
const NAMED: usize = 3;

/// The name of a curve: that of its run, or of all runs that repeat each other.
fn name_of_seeds(runs: &[Compared], places: &[usize]) -> String {
    let label =
        |place: usize| runs[place].label.split_once(' ').unwrap_or((&runs[place].label, ""));
    match places {
        [only] => runs[*only].label.clone(),
        several => {
            let mut ids: Vec<&str> = several.iter().map(|&place| label(place).0).collect();
            // The links above the figure have all of them.
            if ids.len() > NAMED {
                ids.truncate(1);
                ids.push("…");
            }
            let all: Vec<Compared> = several.iter().map(|&place| runs[place].clone()).collect();
            let mean = match (all.len(), comparison::seeds(&all)) {
                (runs, seeds) if runs == seeds => format!("{seeds} seeds"),
                (runs, seeds) => format!("{runs} runs, {}", text::counted(seeds, "seed")),
            };
            format!("{} {}, mean of {mean}", ids.join(" "), label(several[0]).1)
        }
    }
}

/// The metrics that say how good models are, or the first ones.
pub fn main_keys(keys: &BTreeSet<&String>) -> Vec<String> {
    let main = [ValidationMetric::RmseDeg.key(), ValidationMetric::Loss.key(), "train/loss"];
    let there = main.into_iter().filter(|&main| keys.iter().any(|key| *key == main));
    let there: Vec<String> = there.map(str::to_owned).collect();
    match there.is_empty() {
        true => keys.iter().take(main.len()).map(|key| (*key).clone()).collect(),
        false => there,
    }
}

impl Asked {
    /// Reads the query. A browser sends a `run` for each ticked row, and people write `run=4,7`.
    fn read(pairs: &[(String, String)]) -> Result<Self, ApiError> {
        let mut asked = Self {
            runs: Vec::new(),
            metric: None,
            over: Over::Step,
            smoothing: 0.0,
            all: false,
            against: None,
            group: None,
            is_csv: false,
        };
        for (name, value) in pairs {
            match name.as_str() {
                "run" => {
                    let names = value.split([',', ' ']).filter(|name| !name.is_empty());
                    for name in names {
                        let allowed = "ids of runs, and identifiers of logged ones";
                        let name: RunName =
                            name.parse().map_err(|_| ApiError::parameter("run", name, allowed))?;
                        if !asked.runs.contains(&name) {
                            asked.runs.push(name);
                        }
                    }
                }
                "metric" => asked.metric = Some(value.clone()),
                "x" => asked.over = Over::read(value)?,
                "smoothing" => {
                    let weight = value.parse().ok().filter(|weight| (0.0..=0.99).contains(weight));
                    asked.smoothing = weight
                        .ok_or_else(|| ApiError::parameter("smoothing", value, "0 to 0.99"))?;
                }
                "all" => asked.all = value == "1",
                "against" => asked.against = Some(value.clone()),
                "group" => asked.group = Some(value.clone()),
                "format" => asked.is_csv = value == CSV,
                _ => {}
            }
        }
        // A curve keeps its colour, whatever the order of the address.
        asked.runs.sort_by_key(|name| match name {
            RunName::Own(id) => (*id, String::new()),
            RunName::Logged(identifier) => (i64::MAX, identifier.clone()),
        });
        if asked.runs.len() > COMPARED_RUNS {
            let allowed = format!("at most {COMPARED_RUNS} runs");
            return Err(ApiError::parameter("run", asked.runs.len(), allowed));
        }
        Ok(asked)
    }
}

impl Over {
    fn read(value: &str) -> Result<Self, ApiError> {
        match value {
            "step" => Ok(Self::Step),
            "time" => Ok(Self::Time),
            _ => Err(ApiError::parameter("x", value, "step or time")),
        }
    }
}
