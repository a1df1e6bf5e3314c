//! Logs to a run: metrics, params and tags, one or many at once.

use axum::Json;
use axum::extract::State;
use serde_json::{Value, json};
use store::{Timestamp, TrackedBatch, TrackedMetric};

use super::runs::{NAME_TAG, run};
use crate::app::App;
use crate::mlflow::{Fields, MlflowError, Request, is_key, limits};

type MlflowResult = Result<Json<Value>, MlflowError>;

pub async fn log_metric(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let batch = TrackedBatch { metrics: vec![metric(fields)?], ..TrackedBatch::default() };
    log(&app, fields, batch).await
}

pub async fn log_param(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let batch = TrackedBatch {
        params: vec![pair(fields, limits::PARAM_VALUE)?],
        ..TrackedBatch::default()
    };
    log(&app, fields, batch).await
}

pub async fn set_tag(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let batch =
        TrackedBatch { tags: vec![pair(fields, limits::TAG_VALUE)?], ..TrackedBatch::default() };
    log(&app, fields, batch).await
}

pub async fn log_batch(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    let metrics = fields.objects("metrics", limits::METRICS_PER_BATCH)?;
    let params = fields.objects("params", limits::TEXTS_PER_BATCH)?;
    let params = params.into_iter().map(|fields| pair(fields, limits::PARAM_VALUE));
    let batch = TrackedBatch {
        metrics: metrics.into_iter().map(metric).collect::<Result<_, _>>()?,
        params: params.collect::<Result<_, _>>()?,
        tags: tags(fields, limits::TAG_VALUE)?,
        name: None,
    };
    let entities = batch.metrics.len() + batch.params.len() + batch.tags.len();
    if entities > limits::ENTITIES_PER_BATCH {
        let allowed = format!("{} metrics, params and tags together", limits::ENTITIES_PER_BATCH);
        return Err(MlflowError::invalid("the batch", &format!("{entities} of them"), &allowed));
    }
    log(&app, fields, batch).await
}

pub async fn delete_tag(State(app): State<App>, request: Request) -> MlflowResult {
    let fields = request.fields();
    app.delete_tracked_tag(&run(fields)?, key(fields)?).await?;
    Ok(Json(json!({})))
}

async fn log(app: &App, fields: Fields<'_>, batch: TrackedBatch) -> MlflowResult {
    let name = batch.tags.iter().rev().find(|(key, _)| key == NAME_TAG);
    let name = name.map(|(_, value)| value.clone()).filter(|name| !name.is_empty());
    app.log_batch(&run(fields)?, &TrackedBatch { name, ..batch }).await?;
    Ok(Json(json!({})))
}

fn metric(fields: Fields<'_>) -> Result<TrackedMetric, MlflowError> {
    let value = fields.number("value")?.ok_or_else(|| missing(fields, "value"))?;
    let time = fields.integer("timestamp")?.ok_or_else(|| missing(fields, "timestamp"))?;
    if time < 0 {
        let allowed = "milliseconds since 1970";
        return Err(MlflowError::invalid(&fields.path("timestamp"), &time.to_string(), allowed));
    }
    Ok(TrackedMetric {
        key: key(fields)?.to_owned(),
        step: fields.integer("step")?.unwrap_or_default(),
        time: Timestamp::from_milliseconds(time),
        value,
    })
}

fn missing(fields: Fields<'_>, name: &str) -> MlflowError {
    MlflowError::missing(&fields.path(name))
}

/// A param or a tag.
fn pair(fields: Fields<'_>, most: usize) -> Result<(String, String), MlflowError> {
    let value = fields.text("value", most)?.unwrap_or_default();
    Ok((key(fields)?.to_owned(), value.to_owned()))
}

pub(super) fn tags(fields: Fields<'_>, most: usize) -> Result<Vec<(String, String)>, MlflowError> {
    let tags = fields.objects("tags", limits::TEXTS_PER_BATCH)?;
    tags.into_iter().map(|tag| pair(tag, most)).collect()
}

/// A key that MLflow's own server also accepts. Its file store uses keys as paths.
pub(super) fn key<'a>(fields: Fields<'a>) -> Result<&'a str, MlflowError> {
    let key = fields.required_text("key", limits::KEY)?;
    if is_key(key) {
        return Ok(key);
    }
    let allowed =
        "letters, digits, _ - . : / and spaces; no part between slashes may be empty, `.` or `..`";
    Err(MlflowError::invalid(&fields.path("key"), key, allowed))
}
