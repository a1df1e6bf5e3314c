//! The page: HTML that works without scripts, from the same data that the API answers with.

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

use askama::Template;
use axum::Router;
use axum::extract::{FromRequestParts, Request};
use axum::http::HeaderMap;
use axum::http::header::{ACCEPT, CACHE_CONTROL, CONTENT_TYPE};
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use wire::Problem;

use crate::app::App;
use crate::error::ApiError;

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
        .route("/static/{name}", get(assets::show))
}

/// An error, told in HTML.
struct PageError(ApiError);

impl<E: Into<ApiError>> From<E> for PageError {
    fn from(error: E) -> Self {
        Self(error.into())
    }
}

/// An extractor of the API whose rejection is told in HTML.
struct InPage<E>(E);

impl<E, S> FromRequestParts<S> for InPage<E>
where
    E: FromRequestParts<S, Rejection = ApiError>,
    S: Send + Sync,
{
    type Rejection = PageError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, PageError> {
        Ok(Self(E::from_request_parts(parts, state).await?))
    }
}

#[derive(Template)]
#[template(path = "problem.html")]
struct ProblemPage {
    problem: Problem,
}

impl IntoResponse for PageError {
    fn into_response(self) -> Response {
        let Self(error) = self;
        error.log();
        let page = ProblemPage { problem: error.to_problem() };
        let mut response = match html(&page) {
            Ok(body) => (error.status(), body).into_response(),
            Err(_) => error.to_json(),
        };
        error.add_headers(&mut response);
        response
    }
}

/// A page, never kept by the browser: it shows what is the case now.
fn html(page: &impl Template) -> Result<Response, ApiError> {
    let headers = [(CONTENT_TYPE, "text/html; charset=utf-8"), (CACHE_CONTROL, "no-store")];
    Ok((headers, page.render()?).into_response())
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
