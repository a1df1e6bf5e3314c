//! Answers with pages, and errors as pages.

use askama::Template;
use axum::extract::{FromRequestParts, Request};
use axum::http::header::{CACHE_CONTROL, CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use store::{Item, StoreError};
use wire::{Problem, Scope};

use crate::access::{Caller, accepts_html, seen_by, wants_a_page};
use crate::error::ApiError;
use crate::page::parts::Link;
use crate::page::text;
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

/// Marks a problem that a page answers.
#[derive(Clone)]
struct OfPage {
    /// The item in the trash that was asked for.
    trashed: Option<Item>,
}

#[derive(Template)]
#[template(path = "problem.html")]
struct ProblemPage {
    title: String,
    detail: String,
    problem: Problem,
    /// The item in the trash that a button restores.
    trashed: Option<Item>,
    back: Link,
}

impl IntoResponse for PageError {
    fn into_response(self) -> Response {
        let Self(error) = self;
        let trashed = match &error {
            ApiError::Store(StoreError::InTrash { item, .. }) => Some(*item),
            _ => None,
        };
        let mut response = error.into_response();
        response.extensions_mut().insert(OfPage { trashed });
        response
    }
}

/// Writes problems as pages for browsers, also those of the guards, which stand before every path.
pub async fn problems_as_pages(request: Request, next: Next) -> Response {
    let is_for_a_page = wants_a_page(&request);
    let back = way_back(request.uri().path(), request.method());
    let response = next.run(request).await;
    let extensions = response.extensions();
    let of_page = extensions.get::<OfPage>().cloned();
    let problem = extensions.get::<Problem>().filter(|_| is_for_a_page || of_page.is_some());
    let Some(problem) = problem.cloned() else { return response };
    let caller = extensions.get::<Caller>().cloned();
    let may_only_read = caller.as_ref().is_some_and(|caller| caller.scope == Scope::Read)
        && response.status() == StatusCode::FORBIDDEN;
    let page = ProblemPage {
        title: match may_only_read {
            true => "This token may only read".to_owned(),
            false => problem.title.clone(),
        },
        detail: text::title(&problem.detail),
        trashed: of_page.and_then(|of_page| of_page.trashed),
        problem,
        back,
    };
    let Ok(written) = seen_by(caller, || html(&page)) else { return response };
    let (mut parts, _) = response.into_parts();
    let (of_html, body) = written.into_parts();
    parts.headers.remove(CONTENT_LENGTH);
    parts.headers.extend(of_html.headers);
    Response::from_parts(parts, body)
}

/// The page that leads on after a problem: that of the form that was sent, or the list of what was
/// asked for.
fn way_back(path: &str, method: &Method) -> Link {
    let is_form = *method == Method::POST;
    let parts: Vec<&str> = path.split('/').skip(1).collect();
    match parts[..] {
        ["jobs"] => Link::new("/launch", "Back to the form"),
        ["datasets" | "robots"] if is_form => Link::new("/upload", "Back to the form"),
        ["queue" | "workers", ..] => Link::new("/workers", "All workers"),
        [kind @ ("jobs" | "runs" | "datasets" | "checkpoints" | "robots"), id, ..] if is_form => {
            let one = kind.trim_end_matches('s');
            Link::new(format!("/{kind}/{id}"), format!("Back to {one} {id}"))
        }
        [kind @ ("runs" | "datasets" | "checkpoints" | "robots" | "evaluations"), _, ..] => {
            Link::new(format!("/{kind}"), format!("All {kind}"))
        }
        _ => Link::new("/", "All experiments"),
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
