//! Refuses unknown query parameters. Otherwise a filter with a misspelled name would be ignored,
//! and the list would contain everything.
//!
//! The known parameters are those of the OpenAPI document.

use std::collections::HashMap;
use std::sync::Arc;

use axum::extract::{MatchedPath, Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::Response;
use utoipa::openapi::path::{Operation, ParameterIn};
use utoipa::openapi::{OpenApi, PathItem, RefOr};

use crate::error::ApiError;

/// The query parameters of each path and method.
#[derive(Clone, Default)]
pub struct KnownParameters(Arc<HashMap<(String, Method), Vec<String>>>);

impl KnownParameters {
    pub fn of(document: &OpenApi) -> Self {
        let mut known = HashMap::new();
        for (path, item) in &document.paths.paths {
            for (method, operation) in operations(item) {
                known.insert((path.clone(), method), query_parameters(operation));
            }
        }
        Self(Arc::new(known))
    }
}

pub fn operations(item: &PathItem) -> impl Iterator<Item = (Method, &Operation)> {
    let get = item.get.as_ref().map(|operation| (Method::GET, operation));
    let post = item.post.as_ref().map(|operation| (Method::POST, operation));
    let patch = item.patch.as_ref().map(|operation| (Method::PATCH, operation));
    let delete = item.delete.as_ref().map(|operation| (Method::DELETE, operation));
    get.into_iter().chain(post).chain(patch).chain(delete)
}

fn query_parameters(operation: &Operation) -> Vec<String> {
    operation
        .parameters
        .iter()
        .flatten()
        .filter_map(|parameter| match parameter {
            RefOr::T(parameter) => Some(parameter),
            RefOr::Ref(_) => None,
        })
        .filter(|parameter| parameter.parameter_in == ParameterIn::Query)
        .map(|parameter| parameter.name.clone())
        .collect()
}

pub async fn refuse_unknown(
    State(known): State<KnownParameters>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    if let Some(query) = request.uri().query().filter(|query| !query.is_empty()) {
        let path = request.extensions().get::<MatchedPath>().map_or("", MatchedPath::as_str);
        let method = match *request.method() {
            Method::HEAD => Method::GET,
            ref other => other.clone(),
        };
        let allowed = known.0.get(&(path.to_owned(), method)).map_or(&[][..], Vec::as_slice);
        let mut names = query.split('&').map(|pair| pair.split('=').next().unwrap_or(""));
        if let Some(unknown) = names.find(|name| !allowed.iter().any(|known| known == name)) {
            let allowed = match allowed {
                [] => "this path takes no query parameters".to_owned(),
                names => names.join(", "),
            };
            return Err(ApiError::parameter("query parameter", unknown, allowed));
        }
    }
    Ok(next.run(request).await)
}
