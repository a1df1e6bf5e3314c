//! Guards for every request: a count, headers that protect browsers, and headers that may come only
//! once.

use std::any::Any;
use std::sync::LazyLock;
use std::time::Instant;

use axum::extract::{MatchedPath, Request, State};
use axum::http::HeaderValue;
use axum::http::header::{
    AUTHORIZATION, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, HeaderName, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use spec::Digest;

use crate::app::App;
use crate::error::ApiError;

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

/// Headers of which a proxy may believe another line than this server.
const ONCE: [HeaderName; 3] = [HOST, AUTHORIZATION, CONTENT_TYPE];

/// Refuses a request that says twice where it goes, who sends it, or what it holds.
pub async fn refuse_repeated(request: Request, next: Next) -> Result<Response, ApiError> {
    let is_repeated = |name: &&HeaderName| request.headers().get_all(*name).iter().count() > 1;
    if let Some(name) = ONCE.iter().find(is_repeated) {
        return Err(ApiError::RepeatedHeader { name: name.clone() });
    }
    Ok(next.run(request).await)
}

/// Everything the page needs comes from this server, and nothing may frame it. The one style within a page is that of figures,
/// known by its digest. An image of the page's own making (`blob:`) is on the way to a PNG.
static POLICY: LazyLock<HeaderValue> = LazyLock::new(|| {
    let figures = STANDARD.encode(Digest::of(figures::style().as_bytes()).as_bytes());
    let policy = format!(
        "default-src 'none'; style-src 'self' 'sha256-{figures}'; script-src 'self'; img-src 'self' blob:; \
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
    let message = spec::panic_message(panic.as_ref());
    tracing::error!(message, "a request handler panicked");
    ApiError::Internal.into_response()
}
