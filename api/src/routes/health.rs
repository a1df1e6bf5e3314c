//! Health and readiness of the server.

use axum::Json;
use axum::extract::State;
use wire::{Health, Readiness};

use crate::app::App;
use crate::error::ApiError;

/// Check the health of the server: whether the database can be written. Needs no token.
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

/// Check whether requests should be sent to this server: the database can be written, and the
/// server is not stopping. Needs no token.
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
