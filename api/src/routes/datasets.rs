//! Datasets and their files.

use axum::Json;
use axum::extract::State;
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use wire::{Dataset, Datasets, Job};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::routes::files::{DatasetFile, FileParameters, TarFile, send, send_or_redirect};
use crate::routes::lists::ListParameters;

/// Datasets, newest first.
#[utoipa::path(
    get,
    path = "/v1/datasets",
    tag = "datasets",
    params(ListParameters),
    responses((status = 200, body = Datasets)),
)]
pub async fn list(
    State(app): State<App>,
    Query(parameters): Query<ListParameters>,
) -> Result<Json<Datasets>, ApiError> {
    Ok(Json(app.datasets(parameters.paging()?).await?))
}

/// A dataset with the files that exist so far.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}",
    tag = "datasets",
    params(("id" = i64, Path)),
    responses((status = 200, body = Dataset)),
)]
pub async fn show(State(app): State<App>, Path(id): Path<i64>) -> Result<Json<Dataset>, ApiError> {
    Ok(Json(app.dataset(id).await?))
}

/// A Parquet file, the samples or the robots of a shard; or `dataset.json`, which explains them.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/files/{name}",
    tag = "datasets",
    params(("id" = i64, Path), ("name" = String, Path), FileParameters),
    responses(DatasetFile),
)]
pub async fn file(
    State(app): State<App>,
    Path((id, name)): Path<(i64, String)>,
    Query(parameters): Query<FileParameters>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let file = app.dataset_file(id, &name).await?;
    send_or_redirect(&app, &method, &headers, file, &parameters).await
}

/// All files of a dataset as one tar, which streams: its size is known at once, and parts of it can be asked for.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/tar",
    tag = "datasets",
    params(("id" = i64, Path)),
    responses(TarFile),
)]
pub async fn tar(
    State(app): State<App>,
    Path(id): Path<i64>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    send(&app, &method, &headers, app.dataset_tar(id).await?).await
}

/// Make every shard again and compare: a new job each time, of which the dataset tells the outcome.
#[utoipa::path(
    post,
    path = "/v1/datasets/{id}/verify",
    tag = "datasets",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    responses((status = 202, body = Job, headers(("Location" = String)))),
)]
pub async fn verify(State(app): State<App>, Path(id): Path<i64>) -> Result<Response, ApiError> {
    let job = app.verify(id).await?;
    let location = format!("/v1/jobs/{}", job.id);
    Ok((StatusCode::ACCEPTED, [(LOCATION, location)], Json(job)).into_response())
}
