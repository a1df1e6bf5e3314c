//! The logs of attempts at tasks, in pages or as a file.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;
use wire::Logs;

use crate::app::App;
use crate::app::logs::LogQuery;
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::routes::files::{LogFile, send};

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct LogParameters {
    /// Only logs of the task with this label or id.
    task: Option<String>,
    /// Only the log of the attempt with this id.
    attempt: Option<i64>,
    /// Only chunks with a larger id. Pass the `next` of the page before. Without `after` and
    /// `before`, the newest chunks.
    after: Option<i64>,
    /// Only chunks with a smaller id. Pass the `previous` of the page after.
    before: Option<i64>,
    /// Largest number of chunks, 1 to 100; 50 by default.
    limit: Option<u32>,
    /// Seconds to wait for chunks after `after`, 0 to 20; 0 by default. An answer without chunks
    /// does not mean the end.
    wait: Option<u32>,
}

/// Get a page of the logs of a job's tasks, or of all jobs of a pipeline: the newest page, oldest
/// line first.
#[utoipa::path(
    get,
    path = "/v1/jobs/{id}/logs",
    tag = "jobs",
    params(("id" = i64, Path), LogParameters),
    responses((status = 200, body = Logs)),
)]
pub async fn list(
    State(app): State<App>,
    Path(id): Path<i64>,
    Query(parameters): Query<LogParameters>,
) -> Result<Json<Logs>, ApiError> {
    let LogParameters { task, attempt, after, before, limit, wait } = parameters;
    let query = LogQuery { task, attempt, after, before, limit, wait };
    Ok(Json(app.logs(id, &query).await?))
}

/// Download the log of an attempt as plain text. While the attempt is running, the log is
/// incomplete.
#[utoipa::path(
    get,
    path = "/v1/attempts/{id}/log",
    tag = "jobs",
    params(("id" = i64, Path)),
    responses(LogFile),
)]
pub async fn file(
    State(app): State<App>,
    Path(id): Path<i64>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let file = app.attempt_log(id).await?;
    send(&app, &method, &headers, file).await
}
