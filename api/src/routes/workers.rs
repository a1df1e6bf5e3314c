//! Workers: the processes that execute tasks.

use axum::Json;
use axum::extract::State;
use wire::{Worker, Workers};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::Path;

/// List workers by name: live ones, and those that died within a day.
#[utoipa::path(
    get,
    path = "/v1/workers",
    tag = "workers",
    responses((status = 200, body = Workers)),
)]
pub async fn list(State(app): State<App>) -> Result<Json<Workers>, ApiError> {
    Ok(Json(app.workers().await?))
}

/// Drain a worker.
///
/// It claims no more tasks, and ends the one that it has. That lasts until it ends or is undrained.
#[utoipa::path(
    post,
    path = "/v1/workers/{name}/drain",
    tag = "workers",
    security((), ("token" = ["admin"])),
    params(("name" = String, Path)),
    responses((status = 200, body = Worker)),
)]
pub async fn drain(
    State(app): State<App>,
    Path(name): Path<String>,
) -> Result<Json<Worker>, ApiError> {
    Ok(Json(app.drain_worker(&name).await?))
}

/// Undrain a worker: it claims tasks again.
#[utoipa::path(
    post,
    path = "/v1/workers/{name}/undrain",
    tag = "workers",
    security((), ("token" = ["admin"])),
    params(("name" = String, Path)),
    responses((status = 200, body = Worker)),
)]
pub async fn undrain(
    State(app): State<App>,
    Path(name): Path<String>,
) -> Result<Json<Worker>, ApiError> {
    Ok(Json(app.undrain_worker(&name).await?))
}
