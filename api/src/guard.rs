//! Guards for every request: a limit of concurrent requests, a deadline, and headers that protect
//! browsers.

use std::any::Any;
use std::sync::{Arc, LazyLock};
use std::time::Instant;

use axum::extract::{MatchedPath, Request, State};
use axum::http::header::{
    CONTENT_SECURITY_POLICY, HeaderName, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use spec::Digest;
use tokio::sync::Semaphore;

use crate::app::App;
use crate::error::ApiError;
use crate::limits::{CONCURRENT_REQUESTS, REQUEST_TIMEOUT};

/// Paths of uploads, for datasets and for artifacts of MLflow's runs.
const UPLOADS: &str = "/v1/datasets";
const ARTIFACTS: &str = "/api/2.0/mlflow-artifacts/artifacts/";

/// Permits for concurrent requests.
#[derive(Clone)]
pub struct RequestLimit(Arc<Semaphore>);

impl RequestLimit {
    pub fn new() -> Self {
        Self(Arc::new(Semaphore::new(CONCURRENT_REQUESTS)))
    }
}

/// Answers within [`REQUEST_TIMEOUT`], or says that it could not. An upload takes as long as its
/// sender needs, and checks the time itself.
pub async fn admit(
    State(limit): State<RequestLimit>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    let _place = limit.0.try_acquire().map_err(|_| ApiError::Crowded)?;
    let path = request.uri().path();
    let is_artifact = request.method() == Method::PUT && path.starts_with(ARTIFACTS);
    if is_artifact || (request.method() == Method::POST && path == UPLOADS) {
        return Ok(next.run(request).await);
    }
    tokio::time::timeout(REQUEST_TIMEOUT, next.run(request)).await.map_err(|_| ApiError::Timeout)
}

/// Counts requests by route, for monitoring.
pub async fn count(State(app): State<App>, request: Request, next: Next) -> Response {
    let began = Instant::now();
    let route = request.extensions().get::<MatchedPath>().cloned();
    let method = request.method().clone();
    let response = next.run(request).await;
    let route = route.as_ref().map(MatchedPath::as_str);
    app.count_request(&method, route, response.status(), began.elapsed());
    response
}

/// Everything the page needs comes from this server, and nothing may frame it. The one style within a page is that of figures,
/// known by its digest.
static POLICY: LazyLock<HeaderValue> = LazyLock::new(|| {
    let figures = STANDARD.encode(Digest::of(figures::style().as_bytes()).as_bytes());
    let policy = format!(
        "default-src 'none'; style-src 'self' 'sha256-{figures}'; script-src 'self'; img-src 'self'; \
         connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    );
    // Base64 has no character that a header cannot have.
    HeaderValue::try_from(policy).unwrap_or(HeaderValue::from_static("default-src 'none'"))
});

const BROWSER_HEADERS: [(HeaderName, HeaderValue); 2] = [
    (X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff")),
    (REFERRER_POLICY, HeaderValue::from_static("same-origin")),
];

pub async fn add_browser_headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    // A page that needs more than others says so itself.
    headers.entry(CONTENT_SECURITY_POLICY).or_insert_with(|| POLICY.clone());
    for (name, value) in BROWSER_HEADERS {
        headers.entry(name).or_insert(value);
    }
    response
}

/// Answers a panic, as a last resort. The caller learns that it is the server's fault, and the log
/// has the details.
#[expect(clippy::needless_pass_by_value, reason = "the layer hands it over")]
pub fn answer_panic(panic: Box<dyn Any + Send + 'static>) -> Response {
    let message = faults::panic_message(panic.as_ref());
    tracing::error!(message, "a request handler panicked");
    ApiError::Internal.into_response()
}
