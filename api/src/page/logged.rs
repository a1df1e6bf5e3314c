//! A run that a client of MLflow logged.

use askama::Template;
use axum::extract::State;
use axum::response::Response;
use reports::{Align, Table};
use serde::Deserialize;
use store::TrackedMetric;
use wire::JobState;

use crate::app::App;
use crate::app::logged::{LoggedRun, WholeLoggedRun};
use crate::charts;
use crate::extract::{Path, Query};
use crate::page::answer::{InPage, PageError, html};
use crate::page::instant::Instant;
use crate::page::parts::{Fact, FileLink};
use crate::page::text;

struct Row {
    name: String,
    experiment: String,
    state: JobState,
    began: Instant,
}

impl Row {
    fn of(logged: &LoggedRun) -> Self {
        let LoggedRun { run, experiment, .. } = logged;
        Self {
            name: run.name.clone(),
            experiment: experiment.clone(),
            state: state(run.status.as_str()),
            began: Instant::new(&run.start_time.to_string()),
        }
    }
}

/// The state of a job that has the colour of MLflow's status.
pub fn state(status: &str) -> JobState {
    match status {
        "RUNNING" => JobState::Running,
        "SCHEDULED" => JobState::Queued,
        "FINISHED" => JobState::Succeeded,
        "KILLED" => JobState::Cancelled,
        _ => JobState::Failed,
    }
}

fn fact(metric: &TrackedMetric) -> Fact {
    Fact::new(&metric.key, text::value(metric.value), format!("at step {}", metric.step))
}

#[derive(Template)]
#[template(path = "logged_run.html")]
struct LoggedRunPage {
    row: Row,
    user: String,
    identifier: String,
    metrics: Vec<Fact>,
    /// The keys of all metrics, and whether each is drawn.
    keys: Vec<(String, bool)>,
    figure: Option<String>,
    /// Whether the figure has the first points only.
    is_cut: bool,
    /// Parameters and tags.
    tables: Vec<Table>,
    artifacts: Vec<FileLink>,
}

#[derive(Deserialize)]
pub struct Shown {
    metric: Option<String>,
}

pub async fn show(
    State(app): State<App>,
    InPage(Path(identifier)): InPage<Path<String>>,
    InPage(Query(shown)): InPage<Query<Shown>>,
) -> Result<Response, PageError> {
    let WholeLoggedRun { logged, params, tags, artifacts } = app.logged_run(&identifier).await?;
    let first = logged.metrics.first().map(|metric| metric.key.clone());
    let key = shown.metric.or(first);
    let (figure, is_cut) = match &key {
        Some(key) => {
            let (points, is_cut) = app.logged_points(&logged.run, key).await?;
            (Some(charts::logged(key, &points).to_svg(figures::Size::PAGE)?), is_cut)
        }
        None => (None, false),
    };
    let file = |name: &str| {
        let run = &logged.run;
        format!(
            "/api/2.0/mlflow-artifacts/artifacts/{}/{}/artifacts/{}",
            run.experiment,
            run.identifier,
            name.split('/').map(encoded).collect::<Vec<_>>().join("/")
        )
    };
    let page = LoggedRunPage {
        user: logged.run.user.clone(),
        metrics: logged.metrics.iter().map(fact).collect(),
        keys: logged
            .metrics
            .iter()
            .map(|metric| (metric.key.clone(), Some(&metric.key) == key.as_ref()))
            .collect(),
        artifacts: artifacts
            .iter()
            .map(|artifact| FileLink {
                url: file(&artifact.name),
                name: artifact.name.clone(),
                size: text::size(artifact.object.size),
            })
            .collect(),
        // Tags of MLflow itself repeat what is above.
        tables: [
            table("Parameters", &params),
            table("Tags", tags.iter().filter(|(key, _)| !key.starts_with("mlflow."))),
        ]
        .into_iter()
        .filter(|table| !table.rows.is_empty())
        .collect(),
        row: Row::of(&logged),
        identifier,
        figure,
        is_cut,
    };
    Ok(html(&page)?)
}

fn table<'a>(title: &str, pairs: impl IntoIterator<Item = &'a (String, String)>) -> Table {
    let mut table = Table::new([("name", Align::Left), ("value", Align::Left)]);
    title.clone_into(&mut table.title);
    for (key, value) in pairs {
        table.push(vec![key.as_str(), value.as_str()]);
    }
    table
}

/// A part of a path as it stands in a URL.
fn encoded(part: &str) -> String {
    form_urlencoded::byte_serialize(part.as_bytes()).collect::<String>().replace('+', "%20")
}
