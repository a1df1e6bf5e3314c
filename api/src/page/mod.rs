//! The page: HTML that works without scripts, from the same data that the API answers with.

mod answer;
mod assets;
mod channels;
mod checkpoint;
mod control;
mod dataset;
mod evaluation;
mod experiments;
mod job;
mod kinds;
mod parts;
mod recordings;
mod report;
mod rows;
mod run;
mod spec_text;
mod text;
mod verification;
mod viewer;
mod workers;

use axum::Router;
use axum::extract::Request;
use axum::http::HeaderMap;
use axum::http::header::ACCEPT;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};

use crate::app::App;
use crate::error::ApiError;
use crate::page::answer::PageError;

pub fn routes() -> Router<App> {
    Router::new()
        .route("/", get(experiments::show))
        .route("/jobs/{id}", get(job::show))
        .route("/jobs/{id}/cancel", post(job::cancel))
        .route("/runs/{id}", get(run::show))
        .route("/evaluations/{id}", get(evaluation::show))
        .route("/datasets/{id}", get(dataset::show))
        .route("/datasets/{id}/verify", post(dataset::verify))
        .route("/checkpoints/{id}", get(checkpoint::show))
        .route("/workers", get(workers::show))
        .route("/workers/{name}/drain", post(workers::drain))
        .route("/workers/{name}/undrain", post(workers::undrain))
        .route("/queue/pause", post(workers::pause))
        .route("/queue/resume", post(workers::resume))
        .route("/static/{name}", get(assets::show))
}

/// Answers what no route does: in HTML to a browser, as a problem to everyone else.
pub async fn no_route(headers: HeaderMap, request: Request) -> Response {
    let error = ApiError::NoRoute { path: request.uri().path().to_owned() };
    let accepts_html = headers
        .get(ACCEPT)
        .and_then(|accept| accept.to_str().ok())
        .is_some_and(|accept| accept.contains("text/html"));
    if accepts_html { PageError(error).into_response() } else { error.into_response() }
}
