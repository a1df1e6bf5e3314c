//! Runs: the records of trainings and evaluations.

use axum::Json;
use axum::extract::State;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::http::{HeaderMap, Method};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use wire::Metric;

use crate::app::App;
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::limits::{POINTS_DEFAULT, POINTS_MAXIMUM};
use crate::routes::files::{ArtifactFile, FileParameters, send_or_redirect};

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
