//! Experiments of MLflow.

use axum::Json;
use axum::extract::State;
use serde_json::{Value, json};

use super::batches::{key, tags};
use super::searching::{filter, limit, orders, skipped_items, view};
use crate::app::App;
use crate::app::mlflow::ExperimentSearch;
use crate::mlflow::{Attribute, Fields, MlflowError, Request, limits};

type MlflowResult = Result<Json<Value>, MlflowError>;

pub async fn create(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let name = name(fields, "name")?;
    // Files are in torqued's own store, so no other location is accepted.
    let location = fields.text("artifact_location", limits::EXPERIMENT_NAME)?;
    if let Some(location) = location.filter(|location| !location.is_empty()) {
        let allowed = "left out: torqued keeps the files of runs itself";
        return Err(MlflowError::invalid("artifact_location", location, allowed));
    }
    let tags = tags(fields, limits::EXPERIMENT_TAG_VALUE)?;
    let id = app.create_experiment(name, &tags).await?;
    Ok(Json(json!({"experiment_id": id.to_string()})))
}

pub async fn show(State(app): State<App>, request: Request) -> MlflowResult {
    let experiment = app.mlflow_experiment(id(request.fields())?).await?;
    Ok(Json(json!({"experiment": experiment})))
}

pub async fn show_named(State(app): State<App>, request: Request) -> MlflowResult {
    let name = request.fields().required_text("experiment_name", limits::EXPERIMENT_NAME)?;
    Ok(Json(json!({"experiment": app.experiment_named(name).await?})))
}

pub async fn search(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let search = ExperimentSearch {
        filter: filter(fields, &Attribute::OF_EXPERIMENTS)?,
        orders: orders(fields, &Attribute::OF_EXPERIMENTS)?,
        view: view(fields, "view_type")?,
        limit: limit(fields, limits::PAGE_DEFAULT, limits::PAGE_MAXIMUM)?,
        skipped: skipped_items(fields)?,
    };
    let (experiments, next) = app.search_experiments(&search).await?;
    let mut answer = json!({"experiments": experiments});
    if let Some(next) = next {
        answer["next_page_token"] = next.into();
    }
    Ok(Json(answer))
}

pub async fn rename(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    app.rename_experiment(id(fields)?, name(fields, "new_name")?).await?;
    Ok(Json(json!({})))
}

pub async fn delete(State(app): State<App>, request: Request) -> MlflowResult {
    app.set_experiment_deleted(id(request.fields())?, true).await?;
    Ok(Json(json!({})))
}

pub async fn restore(State(app): State<App>, request: Request) -> MlflowResult {
    app.set_experiment_deleted(id(request.fields())?, false).await?;
    Ok(Json(json!({})))
}

pub async fn set_tag(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let value = fields.text("value", limits::EXPERIMENT_TAG_VALUE)?.unwrap_or_default();
    app.tag_experiment(id(fields)?, key(fields)?, Some(value)).await?;
    Ok(Json(json!({})))
}

pub async fn delete_tag(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    app.tag_experiment(id(fields)?, key(fields)?, None).await?;
    Ok(Json(json!({})))
}

fn id<'a>(fields: Fields<'a>) -> Result<&'a str, MlflowError> {
    fields.required_text("experiment_id", limits::KEY)
}

fn name<'a>(fields: Fields<'a>, field: &str) -> Result<&'a str, MlflowError> {
    let name = fields.required_text(field, limits::EXPERIMENT_NAME)?;
    if name.trim().is_empty() {
        return Err(MlflowError::invalid(field, name, "a name that is not blank"));
    }
    Ok(name)
}
