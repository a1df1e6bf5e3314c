//! Runs of MLflow.

use axum::Json;
use axum::extract::State;
use serde_json::{Value, json};
use store::{ExperimentId, Timestamp, TrackedRunChange, TrackedStatus};

use super::batches::tags;
use super::searching::{filter, limit, orders, skipped, skipped_items, view};
use crate::app::App;
use crate::app::mlflow::{RunName, RunSearch, experiment_id};
use crate::mlflow::{Attribute, Fields, MlflowError, Request, limits};

type MlflowResult = Result<Json<Value>, MlflowError>;

/// The largest number of experiments in one search.
const EXPERIMENTS: usize = 10_000;

pub async fn create(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let experiment = match fields.text("experiment_id", limits::KEY)? {
        None | Some("") => ExperimentId::DEFAULT,
        Some(id) => experiment_id(id)?,
    };
    let tags = tags(fields, limits::TAG_VALUE)?;
    let tagged = || tags.iter().find(|(key, _)| key == NAME_TAG).map(|(_, value)| value.clone());
    let name = run_name(fields)?.map(str::to_owned).or_else(tagged);
    let user = fields.text("user_id", limits::RUN_NAME)?.unwrap_or_default().to_owned();
    let start_time = fields.integer("start_time")?;
    let run = app.create_tracked_run(experiment, name, user, start_time, tags).await?;
    Ok(Json(json!({"run": run})))
}

pub async fn show(State(app): State<App>, request: Request) -> MlflowResult {
    Ok(Json(json!({"run": app.mlflow_run(&run(request.fields())?).await?})))
}

pub async fn search(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let experiments = fields.texts("experiment_ids", EXPERIMENTS)?;
    let search = RunSearch {
        experiments: experiments.into_iter().map(experiment_id).collect::<Result<_, _>>()?,
        filter: filter(fields, &Attribute::OF_RUNS)?,
        orders: orders(fields, &Attribute::OF_RUNS)?,
        view: view(fields, "run_view_type")?,
        limit: limit(fields, limits::PAGE_DEFAULT, limits::PAGE_MAXIMUM)?,
        skipped: skipped_items(fields)?,
        newest: false,
    };
    let (runs, next) = app.search_runs(&search).await?;
    let mut answer = json!({"runs": runs});
    if let Some(next) = next {
        answer["next_page_token"] = next.into();
    }
    Ok(Json(answer))
}

pub async fn update(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let change = TrackedRunChange {
        name: run_name(fields)?.map(str::to_owned),
        status: fields.text("status", limits::KEY)?.map(status).transpose()?,
        end_time: fields.integer("end_time")?.map(Timestamp::from_milliseconds),
    };
    Ok(Json(json!({"run_info": app.change_tracked_run(&run(fields)?, &change).await?})))
}

pub async fn delete(State(app): State<App>, request: Request) -> MlflowResult {
    app.set_tracked_run_deleted(&run(request.fields())?, true).await?;
    Ok(Json(json!({})))
}

pub async fn restore(State(app): State<App>, request: Request) -> MlflowResult {
    app.set_tracked_run_deleted(&run(request.fields())?, false).await?;
    Ok(Json(json!({})))
}

pub async fn history(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let key = fields.required_text("metric_key", limits::KEY)?;
    let limit = limit(fields, limits::HISTORY_PAGE, limits::PAGE_MAXIMUM)?;
    let (metrics, next) = app.metric_history(&run(fields)?, key, skipped(fields)?, limit).await?;
    let mut answer = json!({"metrics": metrics});
    if let Some(next) = next {
        answer["next_page_token"] = next.into();
    }
    Ok(Json(answer))
}

/// The tag in which clients send a run's name a second time.
pub(super) const NAME_TAG: &str = "mlflow.runName";

/// The run of a request. Older clients call the field `run_uuid`.
pub(super) fn run(fields: Fields<'_>) -> Result<RunName, MlflowError> {
    let known = fields.text("run_id", limits::KEY)?.filter(|id| !id.is_empty());
    let id = match known {
        Some(id) => id,
        None => fields
            .text("run_uuid", limits::KEY)?
            .filter(|id| !id.is_empty())
            .ok_or_else(|| MlflowError::missing("run_id"))?,
    };
    Ok(RunName::parse(id))
}

fn run_name<'a>(fields: Fields<'a>) -> Result<Option<&'a str>, MlflowError> {
    Ok(fields.text("run_name", limits::RUN_NAME)?.filter(|name| !name.is_empty()))
}

fn status(text: &str) -> Result<TrackedStatus, MlflowError> {
    text.parse().map_err(|_| {
        let known = TrackedStatus::ALL.map(TrackedStatus::as_str).join(", ");
        MlflowError::invalid("status", text, &known)
    })
}
