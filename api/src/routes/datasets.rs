//! Datasets and their files.

use axum::Json;
use axum::extract::State;
use axum::http::header::LOCATION;
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use store::Thing;
use wire::{Dataset, Datasets, Job, LabelChange, Listed};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;
use crate::extract::{PatchBytes, Path, Query, QueryPairs};
use crate::routes::files::{DatasetFile, FileParameters, TarFile, send, send_or_redirect};
use crate::routes::lists::Parameters;

/// List datasets, newest first unless `sort` says otherwise.
#[utoipa::path(
    get,
    path = "/v1/datasets",
    tag = "datasets",
    params(Parameters<Dataset>),
    responses((status = 200, body = Datasets)),
)]
pub async fn list(State(app): State<App>, pairs: QueryPairs) -> Result<Json<Datasets>, ApiError> {
    Ok(Json(app.datasets(&ListRequest::read(&Dataset::LIST, &pairs.0)?).await?))
}

/// Get a dataset with the files that exist so far.
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

/// Change a dataset's name, note or tags.
#[utoipa::path(
    patch,
    path = "/v1/datasets/{id}",
    tag = "datasets",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    request_body(content(
        (LabelChange = "application/merge-patch+json"),
        (LabelChange = "application/json"),
    )),
    responses((status = 200, body = Dataset)),
)]
pub async fn label(
    State(app): State<App>,
    Path(id): Path<i64>,
    PatchBytes(body): PatchBytes,
) -> Result<Json<Dataset>, ApiError> {
    app.label(Thing::Dataset, id, &app.read_body(body).await?).await?;
    Ok(Json(app.dataset(id).await?))
}

/// Download a file of a dataset: a Parquet file with the samples or the robots of a shard, or
/// `dataset.json`, which describes them.
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

/// Download all files of a dataset as one tar.
///
/// The tar is streamed. Its size is known at once, and ranges of it can be requested.
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

/// Verify a dataset: make every shard again and compare it.
///
/// Each request makes a new job. The dataset shows the result.
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
