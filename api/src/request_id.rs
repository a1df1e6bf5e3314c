//! An id for every request: the caller's, or a new one. The answer and every log line about the
//! request have it.

use std::hash::{BuildHasher, RandomState};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};

use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue};
use axum::middleware::Next;
use axum::response::Response;
use tracing::Instrument;

use crate::limits::REQUEST_ID_BYTES;

const X_REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Gives the request its id, and returns the id with the answer.
pub async fn identify(request: Request, next: Next) -> Response {
    let offered = request.headers().get(&X_REQUEST_ID).and_then(|id| id.to_str().ok());
    let id = offered.filter(|id| is_plain(id)).map_or_else(new_id, str::to_owned);
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let span = tracing::info_span!("http", request = id, %method, path);
    let mut response = next.run(request).instrument(span).await;
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(X_REQUEST_ID, value);
    }
    response
}

/// Whether an id can be used in logs. Other ids are replaced.
fn is_plain(id: &str) -> bool {
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.:/+=".contains(&byte);
    (1..=REQUEST_ID_BYTES).contains(&id.len()) && id.bytes().all(is_allowed)
}

/// A unique number, for all requests and servers.
fn new_id() -> String {
    static KEYS: LazyLock<[RandomState; 2]> = LazyLock::new(Default::default);
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let [high, low] = KEYS.each_ref().map(|keys| keys.hash_one(count));
    format!("{high:016x}{low:016x}")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn no_two_requests_have_one_name() {
        let ids: BTreeSet<String> = (0..1000).map(|_| new_id()).collect();
        assert_eq!(ids.len(), 1000);
        assert!(ids.iter().all(|id| is_plain(id) && id.len() == 32));
    }

    #[test]
    fn a_name_that_could_forge_a_line_of_a_log_is_replaced() {
        for id in ["", "a b", "a\"b", "x\u{1b}[31m", &"x".repeat(REQUEST_ID_BYTES + 1)] {
            assert!(!is_plain(id), "{id:?}");
        }
    }
}
