//! Predictions with a checkpoint: single ones, or a stream.

use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::{FromRef as _, State};
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_TYPE, HOST, ORIGIN};
use axum::response::{IntoResponse, Response};
use wire::{Prediction, PredictionRequest, TorqueAnswer, TorqueRequest};

use crate::app::App;
use crate::app::streams::PredictionStream;
use crate::checks::Checks;
use crate::error::ApiError;
use crate::extract::{Path, QuestionBytes};
use crate::limits::QUESTION_BYTES;
use crate::stream;

/// Predict joint positions at once, without a job.
#[utoipa::path(
    post,
    path = "/v1/checkpoints/{id}/predict",
    tag = "predictions",
    security((), ("token" = ["read"])),
    params(("id" = i64, Path)),
    request_body = PredictionRequest,
    responses((status = 200, body = Prediction)),
)]
pub async fn predict(
    State(app): State<App>,
    Path(id): Path<i64>,
    QuestionBytes { body, memory: _memory }: QuestionBytes,
) -> Result<Response, ApiError> {
    let answer = app.predict(id, body).await?;
    Ok(([(CONTENT_TYPE, "application/json")], answer).into_response())
}

/// Ask for the torques that a motion takes, without a job.
///
/// The model fits a robot to the context, which must have equations of motion: a `lagrangian`. It is
/// remembered, so further motions after the same context are answered at once.
#[utoipa::path(
    post,
    path = "/v1/checkpoints/{id}/torque",
    tag = "predictions",
    security((), ("token" = ["read"])),
    params(("id" = i64, Path)),
    request_body = TorqueRequest,
    responses((status = 200, body = TorqueAnswer)),
)]
pub async fn say_torques(
    State(app): State<App>,
    Path(id): Path<i64>,
    QuestionBytes { body, memory: _memory }: QuestionBytes,
) -> Result<Response, ApiError> {
    let answer = app.say_torques(id, body).await?;
    Ok(([(CONTENT_TYPE, "application/json")], answer).into_response())
}

/// Open a WebSocket for predictions with a receding horizon. docs/prediction.md describes its
/// messages.
#[utoipa::path(
    get,
    path = "/v1/checkpoints/{id}/stream",
    tag = "predictions",
    params(("id" = i64, Path)),
    responses((status = 101, description = "The stream is open")),
)]
pub async fn open_stream(
    State(app): State<App>,
    Path(id): Path<i64>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, ApiError> {
    let upgrade =
        upgrade.map_err(|rejection| ApiError::Handshake { reason: rejection.body_text() })?;
    refuse_other_sites(&headers)?;
    let place = app.places().prediction_stream()?;
    let stream = PredictionStream::new(app.held_model(id).await?, Checks::from_ref(&app));
    let upgrade = upgrade.max_message_size(QUESTION_BYTES).max_frame_size(QUESTION_BYTES);
    let closing = app.places().closing();
    Ok(upgrade.on_upgrade(move |socket| stream::serve(socket, stream, closing, place)))
}

/// Refuses pages of other sites. Browsers open a WebSocket to any site with the user's credentials,
/// and send the page's origin.
fn refuse_other_sites(headers: &HeaderMap) -> Result<(), ApiError> {
    let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    let Some(origin) = text(ORIGIN) else { return Ok(()) };
    let site = origin.split_once("://").map(|(_, site)| site);
    if site.is_some_and(|site| text(HOST).is_some_and(|host| host.eq_ignore_ascii_case(site))) {
        return Ok(());
    }
    Err(ApiError::CrossSite)
}
