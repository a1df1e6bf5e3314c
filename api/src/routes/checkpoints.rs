//! Checkpoints and their files.

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use wire::{Checkpoint, Checkpoints};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::routes::files::{CheckpointFile, FileParameters, TarFile, send, send_or_redirect};
use crate::routes::lists::ListParameters;

/// Checkpoints, newest first.
#[utoipa::path(
    get,
    path = "/v1/checkpoints",
    tag = "checkpoints",
    params(ListParameters),
    responses((status = 200, body = Checkpoints)),
)]
pub async fn list(
    State(app): State<App>,
    Query(parameters): Query<ListParameters>,
) -> Result<Json<Checkpoints>, ApiError> {
    Ok(Json(app.checkpoints(parameters.paging()?).await?))
}

/// A checkpoint with its files.
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

/// A file of a checkpoint: weights and optimizer as safetensors, configuration as JSON.
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

/// All files of a checkpoint as one tar, which streams: its size is known at once, and parts of it can be asked for.
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
