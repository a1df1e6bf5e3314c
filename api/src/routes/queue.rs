//! The queue as a whole.

use axum::Json;
use axum::extract::State;
use wire::Queue;

use crate::app::App;
use crate::error::ApiError;

/// Whether tasks are claimed, and how many there are.
#[utoipa::path(get, path = "/v1/queue", tag = "queue", responses((status = 200, body = Queue)))]
pub async fn show(State(app): State<App>) -> Result<Json<Queue>, ApiError> {
    Ok(Json(app.queue().await?))
}

/// Have no more tasks claimed. Those that workers have go on, and jobs can be submitted.
#[utoipa::path(
    post,
    path = "/v1/queue/pause",
    tag = "queue",
    security((), ("token" = ["admin"])),
    responses((status = 200, body = Queue)),
)]
pub async fn pause(State(app): State<App>) -> Result<Json<Queue>, ApiError> {
    Ok(Json(app.pause_queue().await?))
}

/// Have tasks claimed again.
#[utoipa::path(
    post,
    path = "/v1/queue/resume",
    tag = "queue",
    security((), ("token" = ["admin"])),
    responses((status = 200, body = Queue)),
)]
pub async fn resume(State(app): State<App>) -> Result<Json<Queue>, ApiError> {
    Ok(Json(app.resume_queue().await?))
}
