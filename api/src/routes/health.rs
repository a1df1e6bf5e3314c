//! Whether the server answers.

use axum::Json;
use axum::extract::State;
use wire::Health;

use crate::app::{App, VERSION};
use crate::error::ApiError;

/// Answers when the database does; needs no token.
#[utoipa::path(
    get,
    path = "/healthz",
    tag = "health",
    security(()),
    responses((status = 200, body = Health)),
)]
pub async fn show(State(app): State<App>) -> Result<Json<Health>, ApiError> {
    let database_schema = app.database_schema().await?;
    Ok(Json(Health { status: "ok".to_owned(), version: VERSION.to_owned(), database_schema }))
}
