//! The processes that execute tasks.

use axum::Json;
use axum::extract::State;
use wire::Workers;

use crate::app::App;
use crate::error::ApiError;

/// Workers by name: those that are there, and those that died within a day.
#[utoipa::path(
    get,
    path = "/v1/workers",
    tag = "workers",
    responses((status = 200, body = Workers)),
)]
pub async fn list(State(app): State<App>) -> Result<Json<Workers>, ApiError> {
    Ok(Json(Workers { workers: app.workers().await? }))
}
