//! Evaluations: their cells and their report.

use axum::Json;
use axum::extract::State;
use wire::{Evaluation, Evaluations, Listed};

use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;
use crate::extract::{Path, QueryPairs};
use crate::routes::lists::Parameters;

/// List evaluations, newest first unless `sort` says otherwise.
#[utoipa::path(
    get,
    path = "/v1/evaluations",
    tag = "evaluations",
    params(Parameters<Evaluation>),
    responses((status = 200, body = Evaluations)),
)]
pub async fn list(
    State(app): State<App>,
    pairs: QueryPairs,
) -> Result<Json<Evaluations>, ApiError> {
    Ok(Json(app.evaluations(&ListRequest::read(&Evaluation::LIST, &pairs.0)?).await?))
}

/// Get an evaluation by the id of its job. It has a `report` when all its cells are evaluated.
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
