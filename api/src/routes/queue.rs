//! The queue as a whole.

use axum::Json;
use axum::extract::State;
use wire::Queue;

use crate::app::App;
use crate::error::ApiError;

/// Get the state of the queue: whether tasks are claimed, and how many there are.
#[utoipa::path(get, path = "/v1/queue", tag = "queue", responses((status = 200, body = Queue)))]
pub async fn show(State(app): State<App>) -> Result<Json<Queue>, ApiError> {
    Ok(Json(app.queue().await?))
}

/// Pause the queue.
///
/// No more tasks are claimed. Running tasks go on, and jobs can still be submitted.
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

/// Resume the queue: tasks are claimed again.
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
