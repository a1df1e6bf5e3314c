//! The page that shows several runs beside each other.

use std::collections::BTreeSet;

use askama::Template;
use axum::extract::State;
use axum::response::Response;
use reports::{Table, comparison};
use spec::ValidationMetric;
use wire::Run;

use crate::app::App;
use crate::charts::{self, Over, Overlaid, overlaid};
use crate::error::ApiError;
use crate::extract::QueryPairs;
use crate::limits::COMPARED_RUNS;
use crate::page::answer::{PageError, html};
use crate::page::parts::Link;

#[derive(Template)]
#[template(path = "compare.html")]
struct ComparePage {
    runs: Vec<Link>,
    ids: Vec<i64>,
    /// The keys of all metrics, and whether each is drawn.
    keys: Vec<(String, bool)>,
    over: Over,
    smoothing: f64,
    all: bool,
    figure: Option<String>,
    /// The numbers that differ, and whether each is drawn.
    numbers: Vec<(String, bool)>,
    /// The metric over one of them.
    scatter: Option<String>,
    tables: Vec<Table>,
}

/// The query of the page.
struct Asked {
    runs: Vec<i64>,
    metric: Option<String>,
    over: Over,
    /// The weight of what came before, below 1.
    smoothing: f64,
    /// Whether parameters are shown that all runs share.
    all: bool,
    /// The parameter over which the metric is drawn.
    against: Option<String>,
}

pub async fn show(State(app): State<App>, pairs: QueryPairs) -> Result<Response, PageError> {
    let asked = Asked::read(&pairs.filled())?;
    let mut runs: Vec<Run> = Vec::with_capacity(asked.runs.len());
    for &id in &asked.runs {
        runs.push(app.run(id).await?);
    }
    let keys: BTreeSet<&String> = runs.iter().flat_map(|run| run.metrics.keys()).collect();
    let key = asked.metric.or_else(|| usual_key(&keys));
    let figure = match &key {
        None => None,
        Some(key) => {
            let mut curves = Vec::new();
            for places in comparison::repetitions(&runs) {
                let mut of_group = Vec::new();
                for &place in &places {
                    of_group.push(app.metric_points(runs[place].id, key).await?);
                }
                curves.push(Overlaid { name: name_of(&runs, &places), curves: of_group });
            }
            Some(overlaid(key, asked.over, asked.smoothing, &curves).to_svg(figures::Size::PAGE)?)
        }
    };
    let numbers = comparison::numbers(&runs);
    let against = asked.against.filter(|name| numbers.contains_key(name));
    let against = against.or_else(|| numbers.keys().next().cloned());
    let scatter = match (&against, &key) {
        (Some(name), Some(key)) => {
            let points = runs.iter().zip(&numbers[name]).map(|(run, number)| {
                let latest = run.metrics.get(key).and_then(|latest| latest.value);
                (comparison::label(run), *number, latest)
            });
            let points: Vec<_> = points.collect();
            Some(charts::scatter(name, key, &points).to_svg(figures::Size::PAGE)?)
        }
        _ => None,
    };
    let page = ComparePage {
        scatter,
        numbers: numbers
            .keys()
            .map(|name| (name.clone(), Some(name) == against.as_ref()))
            .collect(),
        runs: runs
            .iter()
            .map(|run| Link::new(format!("/runs/{}", run.id), comparison::label(run)))
            .collect(),
        ids: asked.runs,
        keys: keys.iter().map(|&known| (known.clone(), Some(known) == key.as_ref())).collect(),
        over: asked.over,
        smoothing: asked.smoothing,
        all: asked.all,
        figure,
        tables: [comparison::metrics(&runs), comparison::parameters(&runs, asked.all)]
            .into_iter()
            .filter(|table| !table.rows.is_empty())
            .collect(),
    };
    Ok(html(&page)?)
}

/// The name of a curve: that of its run, or of all runs that repeat each other.
fn name_of(runs: &[Run], places: &[usize]) -> String {
    match places {
        [only] => comparison::label(&runs[*only]),
        several => {
            let ids: Vec<String> =
                several.iter().map(|&place| runs[place].id.to_string()).collect();
            format!("{} {}, mean of {} seeds", ids.join(" "), runs[several[0]].name, ids.len())
        }
    }
}

/// The metric that says how good a model is, or the first one.
fn usual_key(keys: &BTreeSet<&String>) -> Option<String> {
    let quality = ValidationMetric::RmseDeg.key();
    let found = keys.iter().find(|key| **key == quality).or_else(|| keys.iter().next());
    found.map(|key| (*key).clone())
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
        };
        for (name, value) in pairs {
            match name.as_str() {
                "run" => {
                    for id in value.split(',') {
                        let id = id.trim().parse().map_err(|_| {
                            ApiError::parameter("run", id, "ids of runs, whole numbers")
                        })?;
                        if !asked.runs.contains(&id) {
                            asked.runs.push(id);
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
                _ => {}
            }
        }
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
