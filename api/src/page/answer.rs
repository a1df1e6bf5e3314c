//! Answers with pages, and errors as pages.

use askama::Template;
use axum::extract::FromRequestParts;
use axum::http::HeaderMap;
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use wire::Problem;

use crate::access::accepts_html;
use crate::error::ApiError;
use crate::relative::with_relative_links;

/// An error that is shown as HTML.
pub struct PageError(pub ApiError);

impl<E: Into<ApiError>> From<E> for PageError {
    fn from(error: E) -> Self {
        Self(error.into())
    }
}

/// An extractor of the API whose rejection is shown as HTML.
pub struct InPage<E>(pub E);

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

/// An error in the form that the request prefers.
pub fn refused(error: ApiError, headers: &HeaderMap) -> Response {
    if accepts_html(headers) { PageError(error).into_response() } else { error.into_response() }
}

/// A page. The browser does not store it, because it shows the present state.
pub fn html(page: &impl Template) -> Result<Response, ApiError> {
    let headers = [(CONTENT_TYPE, "text/html; charset=utf-8"), (CACHE_CONTROL, "no-store")];
    Ok((headers, with_relative_links(page.render()?)).into_response())
}
