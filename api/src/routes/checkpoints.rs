//! Checkpoints and their files.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use store::Thing;
use wire::{Checkpoint, Checkpoints, LabelChange, Listed};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;
use crate::extract::{PatchBytes, Path, Query, QueryPairs};
use crate::routes::files::{CheckpointFile, FileParameters, TarFile, send, send_or_redirect};
use crate::routes::lists::Parameters;

/// List checkpoints, newest first unless `sort` says otherwise.
#[utoipa::path(
    get,
    path = "/v1/checkpoints",
    tag = "checkpoints",
    params(Parameters<Checkpoint>),
    responses((status = 200, body = Checkpoints)),
)]
pub async fn list(
    State(app): State<App>,
    pairs: QueryPairs,
) -> Result<Json<Checkpoints>, ApiError> {
    Ok(Json(app.checkpoints(&ListRequest::read(&Checkpoint::LIST, &pairs.0)?).await?))
}

/// Get a checkpoint with its files.
#[utoipa::path(
    get,
    path = "/v1/checkpoints/{id}",
    tag = "checkpoints",
    params(("id" = i64, Path)),
    responses((status = 200, body = Checkpoint)),
)]
pub async fn show(
    State(app): State<App>,
    Path(id): Path<i64>,
) -> Result<Json<Checkpoint>, ApiError> {
    Ok(Json(app.checkpoint(id).await?))
}

/// Change a checkpoint's name, note or tags.
#[utoipa::path(
    patch,
    path = "/v1/checkpoints/{id}",
    tag = "checkpoints",
    security((), ("token" = ["submit"])),
    params(("id" = i64, Path)),
    request_body(content(
        (LabelChange = "application/merge-patch+json"),
        (LabelChange = "application/json"),
    )),
    responses((status = 200, body = Checkpoint)),
)]
pub async fn label(
    State(app): State<App>,
    Path(id): Path<i64>,
    PatchBytes(body): PatchBytes,
) -> Result<Json<Checkpoint>, ApiError> {
    app.label(Thing::Checkpoint, id, &app.read_body(body).await?).await?;
    Ok(Json(app.checkpoint(id).await?))
}

/// Download a file of a checkpoint: weights and optimizer as safetensors, configuration as JSON.
#[utoipa::path(
    get,
    path = "/v1/checkpoints/{id}/files/{name}",
    tag = "checkpoints",
    params(("id" = i64, Path), ("name" = String, Path), FileParameters),
    responses(CheckpointFile),
)]
pub async fn file(
    State(app): State<App>,
    Path((id, name)): Path<(i64, String)>,
    Query(parameters): Query<FileParameters>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let file = app.checkpoint_file(id, &name).await?;
    send_or_redirect(&app, &method, &headers, file, &parameters).await
}

/// Download all files of a checkpoint as one tar.
///
/// The tar is streamed. Its size is known at once, and ranges of it can be requested.
#[utoipa::path(
    get,
    path = "/v1/checkpoints/{id}/tar",
    tag = "checkpoints",
    params(("id" = i64, Path)),
    responses(TarFile),
)]
pub async fn tar(
    State(app): State<App>,
    Path(id): Path<i64>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    send(&app, &method, &headers, app.checkpoint_tar(id).await?).await
}
