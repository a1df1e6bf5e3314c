//! Metrics for monitoring systems.

use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;

use crate::app::App;
use crate::app::monitoring::MEDIA_TYPE;
use crate::error::ApiError;

/// Get metrics for Prometheus.
///
/// They have jobs, tasks and attempts by kind, the queue, workers, free disk space, and response
/// times. Counts from the store are up to 10 s old.
#[utoipa::path(
    get,
    path = "/metrics",
    tag = "health",
    responses((status = 200, body = String, content_type = "application/openmetrics-text")),
)]
pub async fn metrics(State(app): State<App>) -> Result<impl IntoResponse, ApiError> {
    Ok(([(CONTENT_TYPE, MEDIA_TYPE)], app.metrics().await?))
}
