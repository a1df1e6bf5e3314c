//! Runs: the records of trainings and evaluations.

use axum::Json;
use axum::extract::State;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::http::{HeaderMap, Method};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use store::Thing;
use utoipa::IntoParams;
use wire::{LabelChange, Listed, Metric, Run, Runs};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;
use crate::extract::{PatchBytes, Path, Query, QueryPairs};
use crate::limits::{POINTS_DEFAULT, POINTS_MAXIMUM};
use crate::routes::files::{ArtifactFile, FileParameters, send_or_redirect};
use crate::routes::lists::Parameters;

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct MetricParameters {
    /// Largest number of points, 2 to 5000. Each part of a longer curve keeps its lowest and
    /// highest point.
    points: Option<u32>,
}

impl MetricParameters {
    fn points(&self) -> Result<u32, ApiError> {
        let points = self.points.unwrap_or(POINTS_DEFAULT);
        if (2..=POINTS_MAXIMUM).contains(&points) {
            return Ok(points);
        }
        Err(ApiError::parameter("points", points, format!("2 to {POINTS_MAXIMUM}")))
    }
}

/// List runs, newest first unless `sort` says otherwise.
#[utoipa::path(
    get,
    path = "/v1/runs",
    tag = "runs",
    params(Parameters<Run>),
    responses((status = 200, body = Runs)),
)]
pub async fn list(State(app): State<App>, pairs: QueryPairs) -> Result<Json<Runs>, ApiError> {
    Ok(Json(app.runs(&ListRequest::read(&Run::LIST, &pairs.0)?).await?))
}

/// Get a run with the latest value of every metric and its artifacts.
#[utoipa::path(
    get,
    path = "/v1/runs/{id}",
    tag = "runs",
    params(("id" = i64, Path)),
    responses((status = 200, body = Run)),
)]
pub async fn show(State(app): State<App>, Path(id): Path<i64>) -> Result<Json<Run>, ApiError> {
    Ok(Json(app.run(id).await?))
}

/// Change a run's name, note or tags.
#[utoipa::path(
    patch,
    path = "/v1/runs/{id}",
    tag = "runs",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    request_body(content(
        (LabelChange = "application/merge-patch+json"),
        (LabelChange = "application/json"),
    )),
    responses((status = 200, body = Run)),
)]
pub async fn label(
    State(app): State<App>,
    Path(id): Path<i64>,
    PatchBytes(body): PatchBytes,
) -> Result<Json<Run>, ApiError> {
    app.label(Thing::Run, id, &app.read_body(body).await?).await?;
    Ok(Json(app.run(id).await?))
}

/// Get the values of one metric. A slash in its key is written `%2F`.
#[utoipa::path(
    get,
    path = "/v1/runs/{id}/metrics/{key}",
    tag = "runs",
    params(("id" = i64, Path), ("key" = String, Path), MetricParameters),
    responses((status = 200, body = Metric)),
)]
pub async fn metric(
    State(app): State<App>,
    Path((id, key)): Path<(i64, String)>,
    Query(parameters): Query<MetricParameters>,
) -> Result<Json<Metric>, ApiError> {
    Ok(Json(app.metric(id, &key, parameters.points()?).await?))
}

/// Get the values of the metric `group/name`, such as `train/loss`.
#[utoipa::path(
    get,
    path = "/v1/runs/{id}/metrics/{group}/{name}",
    tag = "runs",
    params(
        ("id" = i64, Path),
        ("group" = String, Path),
        ("name" = String, Path),
        MetricParameters,
    ),
    responses((status = 200, body = Metric)),
)]
pub async fn metric_of_group(
    State(app): State<App>,
    Path((id, group, name)): Path<(i64, String, String)>,
    Query(parameters): Query<MetricParameters>,
) -> Result<Json<Metric>, ApiError> {
    Ok(Json(app.metric(id, &format!("{group}/{name}"), parameters.points()?).await?))
}

/// Download a file that the run left, such as `report.json` or `rmse-multisine.svg`.
#[utoipa::path(
    get,
    path = "/v1/runs/{id}/artifacts/{name}",
    tag = "runs",
    params(("id" = i64, Path), ("name" = String, Path), FileParameters),
    responses(ArtifactFile),
)]
pub async fn artifact(
    State(app): State<App>,
    Path((id, name)): Path<(i64, String)>,
    Query(parameters): Query<FileParameters>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let file = app.run_artifact(id, &name).await?;
    send_or_redirect(&app, &method, &headers, file, &parameters).await
}

/// Get the curves of validation error and loss so far as `loss.svg`, or the losses as `loss.csv`.
#[utoipa::path(
    get,
    path = "/v1/runs/{id}/figures/{name}",
    tag = "runs",
    params(("id" = i64, Path), ("name" = String, Path)),
    responses((
        status = 200,
        content((String = "image/svg+xml"), (String = "text/csv")),
    )),
)]
pub async fn figure(
    State(app): State<App>,
    Path((id, name)): Path<(i64, String)>,
) -> Result<Response, ApiError> {
    let curves = app.training_curves(id).await?;
    let (media_type, text) = match name.as_str() {
        "loss.svg" => ("image/svg+xml", curves.svg()?),
        "loss.csv" => ("text/csv; charset=utf-8", curves.losses().to_csv()),
        _ => {
            return Err(ApiError::not_found(
                "figure",
                format!("{name:?}; there are loss.svg and loss.csv"),
            ));
        }
    };
    let disposition = format!("attachment; filename=\"run-{id}-{name}\"");
    let headers = [(CONTENT_TYPE, media_type), (CONTENT_DISPOSITION, disposition.as_str())];
    Ok((headers, text).into_response())
}
