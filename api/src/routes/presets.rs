//! Presets: named starting points of specs.

use axum::Json;
use wire::Presets;

/// List all presets with their specs.
#[utoipa::path(
    get,
    path = "/v1/presets",
    tag = "presets",
    responses((status = 200, body = Presets)),
)]
pub async fn list() -> Json<Presets> {
    Json(Presets { presets: spec::presets().to_vec() })
}
