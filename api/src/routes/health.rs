//! Whether the server answers.

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::VERSION;
use crate::app::App;
use crate::error::ApiError;

#[derive(Serialize, ToSchema)]
pub struct Health {
    #[schema(example = "ok")]
    pub status: &'static str,
    pub version: &'static str,
    /// Version of the database's schema.
    pub database_schema: i64,
}

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
    Ok(Json(Health { status: "ok", version: VERSION, database_schema }))
}
