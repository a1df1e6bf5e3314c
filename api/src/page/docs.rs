//! Swagger UI on the server's own document, to read and try the API's operations.
//!
//! The files of Swagger UI come with a crate and are part of the binary.

use std::borrow::Cow;
use std::sync::Arc;

use askama::Template;
use axum::extract::Path;
use axum::http::HeaderMap;
use axum::http::HeaderValue;
use axum::http::header::{ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, VARY};
use axum::response::{IntoResponse, Response};
use utoipa_swagger_ui::Config;

use crate::error::ApiError;
use crate::page::answer::{PageError, html};
use crate::page::assets;

#[derive(Template)]
#[template(path = "docs.html")]
struct DocsPage;

/// The policy of other pages, extended for the small images in Swagger UI's style sheets.
const POLICY: &str = "default-src 'none'; style-src 'self'; script-src 'self'; \
                      img-src 'self' data:; connect-src 'self'; form-action 'self'; \
                      base-uri 'none'; frame-ancestors 'none'";

/// The files of Swagger UI that the page loads. The crate has more.
const FILES: [(&str, &str); 2] = [
    ("swagger-ui.css", "text/css; charset=utf-8"),
    ("swagger-ui-bundle.js", "text/javascript; charset=utf-8"),
];

pub async fn show() -> Result<Response, PageError> {
    let policy = [(CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY))];
    Ok((policy, html(&DocsPage)?).into_response())
}

pub async fn file(Path(name): Path<String>, headers: HeaderMap) -> Result<Response, ApiError> {
    let no_file = || ApiError::NoRoute { path: format!("/docs/{name}") };
    let (_, media_type) =
        FILES.into_iter().find(|(known, _)| *known == name).ok_or_else(no_file)?;
    let found = utoipa_swagger_ui::serve(&name, Arc::new(Config::default()));
    let file = found.ok().flatten().ok_or_else(no_file)?;
    // Only Swagger UI's initializer, which the page does not use, is made for each request.
    let Cow::Borrowed(bytes) = file.bytes else { return Err(no_file()) };
    let mut response = assets::answer(media_type, bytes, &headers);
    if file.gzpipped {
        response.headers_mut().insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        response.headers_mut().insert(VARY, ACCEPT_ENCODING.into());
    }
    Ok(response)
}
