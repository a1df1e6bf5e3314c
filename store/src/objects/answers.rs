//! Whether a remote object store answers requests.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use object_store::client::{HttpError, HttpResponse};

/// The moment since when every request has failed, if the last one did. Clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Answers {
    failing_since: Arc<Mutex<Option<Instant>>>,
}

impl Answers {
    pub fn note(&self, answer: &Result<HttpResponse, HttpError>) {
        // "Not found" and "exists already" are answers like any other.
        let is_failure = answer.as_ref().map_or(true, |answer| {
            let status = answer.status().as_u16();
            status >= 500 || matches!(status, 401 | 403 | 429)
        });
        let mut since = self.failing_since.lock().unwrap_or_else(PoisonError::into_inner);
        *since = if is_failure { since.or_else(|| Some(Instant::now())) } else { None };
    }

    /// How long every request has failed.
    pub fn failing_for(&self) -> Option<Duration> {
        let since = self.failing_since.lock().unwrap_or_else(PoisonError::into_inner);
        since.map(|since| since.elapsed())
    }
}
