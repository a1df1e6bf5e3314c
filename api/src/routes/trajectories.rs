//! Contents of datasets: single trajectories, and summaries of all.

use axum::Json;
use axum::extract::State;
use axum::http::header::{ACCEPT, CONTENT_DISPOSITION, CONTENT_TYPE, VARY};
use axum::http::{HeaderMap, HeaderName};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use wire::{Summary, Trajectory, TrajectoryPredictions};

use crate::app::App;
use crate::charts;
use crate::error::ApiError;
use crate::extract::{Path, Query, QueryPairs};

const ARROW: &str = "application/vnd.apache.arrow.stream";
const SVG: &str = "image/svg+xml";
const CSV: &str = "text/csv; charset=utf-8";

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    Json,
    Arrow,
}

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub struct FormatParameters {
    /// Takes precedence over `Accept`. JSON by default.
    #[param(inline)]
    format: Option<Format>,
}

/// Get a trajectory with its robot: as JSON, or its samples as an Arrow IPC stream.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/trajectories/{index}",
    tag = "datasets",
    params(("id" = i64, Path), ("index" = u64, Path), FormatParameters),
    responses((
        status = 200,
        content(
            (Trajectory = "application/json"),
            (Vec<u8> = "application/vnd.apache.arrow.stream"),
        ),
    )),
)]
pub async fn show(
    State(app): State<App>,
    Path((id, index)): Path<(i64, u64)>,
    Query(parameters): Query<FormatParameters>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let trajectory = app.trajectory(id, index).await?;
    let vary = [(VARY, "accept")];
    match parameters.format.unwrap_or_else(|| accepted(&headers)) {
        Format::Json => Ok((vary, Json(trajectory.to_resource())).into_response()),
        Format::Arrow => {
            let name = format!("dataset-{id}-trajectory-{index}.arrows");
            Ok((vary, saved_as(&name, ARROW), trajectory.to_arrow()?).into_response())
        }
    }
}

/// Draw a trajectory's torques, positions and other recorded channels over time.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/trajectories/{index}/figure.svg",
    tag = "datasets",
    params(("id" = i64, Path), ("index" = u64, Path)),
    responses((status = 200, body = String, content_type = "image/svg+xml")),
)]
pub async fn figure(
    State(app): State<App>,
    Path((id, index)): Path<(i64, u64)>,
) -> Result<Response, ApiError> {
    let drawn = charts::trajectory_svg(&app.trajectory(id, index).await?)?;
    Ok((saved_as(&format!("dataset-{id}-trajectory-{index}.svg"), SVG), drawn).into_response())
}

/// Get a trajectory as CSV, with one line per sample.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/trajectories/{index}/figure.csv",
    tag = "datasets",
    params(("id" = i64, Path), ("index" = u64, Path)),
    responses((status = 200, body = String, content_type = "text/csv")),
)]
pub async fn figure_data(
    State(app): State<App>,
    Path((id, index)): Path<(i64, u64)>,
) -> Result<Response, ApiError> {
    let table = app.trajectory(id, index).await?.to_csv();
    Ok((saved_as(&format!("dataset-{id}-trajectory-{index}.csv"), CSV), table).into_response())
}

/// The parameters of [`predictions`], which reads them itself.
#[derive(IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "they document the operation")]
pub struct PredictionsParameters {
    /// Ids or aliases of checkpoints, separated by commas; at most 6.
    #[param(example = "3,5")]
    checkpoint: Option<String>,
    /// The sample at which the horizon begins. Default: the end of the longest context.
    begin: Option<usize>,
    /// Number of samples of each checkpoint that gives several answers. 16 by default; 1 asks for a
    /// single answer.
    samples: Option<u32>,
    /// Number of steps of the samplers of models that remove noise. Default: that of the training.
    steps: Option<u32>,
    /// The seed of all samples. 0 by default.
    seed: Option<u64>,
}

/// Predict a stored trajectory with checkpoints, beside what happened.
///
/// The context is what sensors measured; the torques after it, or the references, are known. The
/// baseline `hold-last` is always there.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/trajectories/{index}/predictions",
    tag = "predictions",
    params(("id" = i64, Path), ("index" = u64, Path), PredictionsParameters),
    responses((status = 200, body = TrajectoryPredictions)),
)]
pub async fn predictions(
    State(app): State<App>,
    Path((id, index)): Path<(i64, u64)>,
    QueryPairs(pairs): QueryPairs,
) -> Result<Json<TrajectoryPredictions>, ApiError> {
    let request = app.predictions_request(&pairs).await?;
    Ok(Json(app.predict_trajectory(id, index, &request).await?))
}

/// Get the summary of a dataset: counts, ranges of all channels and mean spectra, over the finished
/// shards.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/summary",
    tag = "datasets",
    params(("id" = i64, Path)),
    responses((status = 200, body = Summary)),
)]
pub async fn summary(
    State(app): State<App>,
    Path(id): Path<i64>,
) -> Result<Json<Summary>, ApiError> {
    Ok(Json(app.summary(id).await?))
}

/// Draw the mean spectra of torques and positions.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/spectrum.svg",
    tag = "datasets",
    params(("id" = i64, Path)),
    responses((status = 200, body = String, content_type = "image/svg+xml")),
)]
pub async fn spectrum(State(app): State<App>, Path(id): Path<i64>) -> Result<Response, ApiError> {
    let drawn = charts::spectra_svg(&app.summary(id).await?)?;
    Ok((saved_as(&format!("dataset-{id}-spectrum.svg"), SVG), drawn).into_response())
}

/// Get the mean spectra as CSV, with one line per signal and frequency: `u` is the mean over all joints, `u3` is of joint 3.
#[utoipa::path(
    get,
    path = "/v1/datasets/{id}/spectrum.csv",
    tag = "datasets",
    params(("id" = i64, Path)),
    responses((status = 200, body = String, content_type = "text/csv")),
)]
pub async fn spectrum_data(
    State(app): State<App>,
    Path(id): Path<i64>,
) -> Result<Response, ApiError> {
    let table = charts::spectra_csv(&app.summary(id).await?);
    Ok((saved_as(&format!("dataset-{id}-spectrum.csv"), CSV), table).into_response())
}

/// Arrow if `Accept` names it, even beside other types.
fn accepted(headers: &HeaderMap) -> Format {
    let named = headers
        .get_all(ACCEPT)
        .iter()
        .filter_map(|accept| accept.to_str().ok())
        .flat_map(|accept| accept.split(','))
        .any(|media_type| {
            media_type.split(';').next().is_some_and(|essence| essence.trim() == ARROW)
        });
    if named { Format::Arrow } else { Format::Json }
}

fn saved_as(name: &str, media_type: &str) -> [(HeaderName, String); 2] {
    [
        (CONTENT_TYPE, media_type.to_owned()),
        (CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
    ]
}
