//! Whether the server works.

use axum::Json;
use axum::extract::State;
use wire::{Health, Readiness};

use crate::app::App;
use crate::error::ApiError;

/// Answers when the database can be written; needs no token.
#[utoipa::path(
    get,
    path = "/healthz",
    tag = "health",
    security(()),
    responses((status = 200, body = Health)),
)]
pub async fn show(State(app): State<App>) -> Result<Json<Health>, ApiError> {
    Ok(Json(app.health().await?))
}

/// Answers when requests should be sent here: the database can be written, and the server does not end; needs no token.
#[utoipa::path(
    get,
    path = "/readyz",
    tag = "health",
    security(()),
    responses((status = 200, body = Readiness)),
)]
pub async fn ready(State(app): State<App>) -> Result<Json<Readiness>, ApiError> {
    Ok(Json(app.readiness().await?))
}
