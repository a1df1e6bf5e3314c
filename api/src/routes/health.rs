//! Whether the server works.

use axum::Json;
use axum::extract::State;
use wire::Health;

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
