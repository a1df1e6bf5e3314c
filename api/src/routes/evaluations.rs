//! Evaluations: their cells and their report.

use axum::Json;
use axum::extract::State;
use wire::{Evaluation, Evaluations};

use crate::app::App;
use crate::error::ApiError;
use crate::extract::{Path, Query};
use crate::routes::lists::ListParameters;

/// Evaluations, newest first.
#[utoipa::path(
    get,
    path = "/v1/evaluations",
    tag = "evaluations",
    params(ListParameters),
    responses((status = 200, body = Evaluations)),
)]
pub async fn list(
    State(app): State<App>,
    Query(parameters): Query<ListParameters>,
) -> Result<Json<Evaluations>, ApiError> {
    Ok(Json(app.evaluations(parameters.paging()?).await?))
}

/// An evaluation, by the id of its job; `report` is there once all its cells are.
#[utoipa::path(
    get,
    path = "/v1/evaluations/{id}",
    tag = "evaluations",
    params(("id" = i64, Path)),
    responses((status = 200, body = Evaluation)),
)]
pub async fn show(
    State(app): State<App>,
    Path(id): Path<i64>,
) -> Result<Json<Evaluation>, ApiError> {
    Ok(Json(app.evaluation(id).await?))
}
