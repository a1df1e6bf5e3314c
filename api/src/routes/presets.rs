//! Named starting points of specs.

use axum::Json;
use serde::Serialize;
use spec::Preset;
use utoipa::ToSchema;

#[derive(Serialize, ToSchema)]
pub struct Presets {
    pub presets: Vec<Preset>,
}

/// Every preset with the spec it stands for.
#[utoipa::path(
    get,
    path = "/v1/presets",
    tag = "presets",
    responses((status = 200, body = Presets)),
)]
pub async fn list() -> Json<Presets> {
    Json(Presets { presets: spec::presets() })
}
