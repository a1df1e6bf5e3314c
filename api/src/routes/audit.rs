//! The audit log.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;
use wire::Audit;

use crate::app::{App, Paging};
use crate::error::ApiError;
use crate::extract::Query;

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct AuditParameters {
    /// Only entries of the token with this name.
    actor: Option<String>,
    /// Largest number of items, 1 to 500; 50 by default.
    limit: Option<u32>,
    /// Only items with a smaller id.
    before: Option<i64>,
}

/// Requests that changed something or were refused, newest first. The newest 100 000 are kept.
#[utoipa::path(
    get,
    path = "/v1/audit",
    tag = "access",
    security((), ("token" = ["admin"])),
    params(AuditParameters),
    responses((status = 200, body = Audit)),
)]
pub async fn list(
    State(app): State<App>,
    Query(parameters): Query<AuditParameters>,
) -> Result<Json<Audit>, ApiError> {
    let AuditParameters { actor, limit, before } = parameters;
    Ok(Json(app.audit(actor.as_deref(), Paging::new(limit, before)?).await?))
}
