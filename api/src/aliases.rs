//! Paths that name a checkpoint by an alias, as `/v1/checkpoints/champion/predict`.
//!
//! They are answered as the paths with its id. This comes after all guards, so nobody learns of an alias who may not read.

use axum::Router;
use axum::extract::{DefaultBodyLimit, MatchedPath, Request, State};
use axum::http::Uri;
use axum::http::uri::PathAndQuery;
use axum::middleware::Next;
use axum::response::Response;
use hyper::upgrade::OnUpgrade;
use tower::ServiceExt as _;

use crate::app::{App, labels};
use crate::error::ApiError;
use crate::limits::BODY_BYTES;
use crate::page::answer::refused;

/// The routes whose first variable is a checkpoint.
const PREFIXES: [&str; 2] = ["/v1/checkpoints/", "/checkpoints/"];

/// Asks `routes`, which are those without guards, for the path with the id.
pub async fn resolve(
    State((app, routes)): State<(App, Router)>,
    mut request: Request,
    next: Next,
) -> Response {
    let Some((prefix, alias, rest)) = named(&request) else { return next.run(request).await };
    let id = match app.checkpoint_of_alias(alias).await {
        Ok(id) => id,
        Err(error) => return refused(error, request.headers()),
    };
    let query = request.uri().query().map(|query| format!("?{query}")).unwrap_or_default();
    let path = format!("{prefix}{id}{rest}{query}");
    let mut parts = request.uri().clone().into_parts();
    parts.path_and_query = PathAndQuery::try_from(path).ok();
    match Uri::from_parts(parts) {
        Ok(uri) => *request.uri_mut() = uri,
        Err(_) => return refused(ApiError::Internal, request.headers()),
    }
    // The request keeps the variables of the first path, and the handler would get those of both.
    let upgrade = request.extensions_mut().remove::<OnUpgrade>();
    request.extensions_mut().clear();
    if let Some(upgrade) = upgrade {
        request.extensions_mut().insert(upgrade);
    }
    DefaultBodyLimit::max(BODY_BYTES).apply(&mut request);
    match routes.oneshot(request).await {
        Ok(response) => response,
        Err(never) => match never {},
    }
}

/// The parts of a path with an alias: what is before it, the alias, and what is behind it.
fn named(request: &Request) -> Option<(&'static str, &str, &str)> {
    let route = request.extensions().get::<MatchedPath>()?.as_str();
    let is_of = |prefix: &&&str| route.strip_prefix(**prefix).is_some_and(|it| it.starts_with('{'));
    let prefix = *PREFIXES.iter().find(is_of)?;
    let after = request.uri().path().strip_prefix(prefix)?;
    let end = after.find('/').unwrap_or(after.len());
    let (alias, rest) = after.split_at(end);
    labels::is_alias(alias).then_some((prefix, alias, rest))
}
