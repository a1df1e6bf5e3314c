//! The trash.

use axum::Json;
use axum::extract::State;
use serde::Deserialize;
use store::Respect;
use utoipa::IntoParams;
use wire::Trash;

use crate::app::{App, Paging};
use crate::error::ApiError;
use crate::extract::Query;

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct DeleteParameters {
    /// Delete it even if ended jobs depend on it. These jobs stay as they are.
    #[serde(default)]
    force: bool,
}

impl DeleteParameters {
    pub fn respect(&self) -> Respect {
        if self.force { Respect::Open } else { Respect::All }
    }
}

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct TrashParameters {
    /// Largest number of items, 1 to 500; 50 by default.
    limit: Option<u32>,
    /// Only items that come after this one. Pass the `next` of the page before.
    before: Option<String>,
}

/// List the trash, latest deletion first. Each item has the date until which it can be restored.
#[utoipa::path(
    get,
    path = "/v1/trash",
    tag = "trash",
    params(TrashParameters),
    responses((status = 200, body = Trash)),
)]
pub async fn list(
    State(app): State<App>,
    Query(parameters): Query<TrashParameters>,
) -> Result<Json<Trash>, ApiError> {
    let limit = Paging::new(parameters.limit, None)?.limit;
    Ok(Json(app.trash(limit, parameters.before.as_deref()).await?))
}
