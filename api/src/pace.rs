//! Limits the rate of requests from one address.

use std::net::IpAddr;
use std::num::NonZero;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;
use governor::clock::{Clock as _, DefaultClock};
use governor::{DefaultKeyedRateLimiter, Quota, RateLimiter};

use crate::error::ApiError;
use crate::limits::BURST_SECONDS;
use crate::remote::{Remote, network};

/// Number of remembered addresses. Above it, addresses without recent requests are forgotten.
const REMEMBERED: usize = 10_000;

/// A limiter that counts the requests that each address may still send.
#[derive(Clone)]
pub struct AddressRateLimit(Arc<DefaultKeyedRateLimiter<IpAddr>>);

impl AddressRateLimit {
    pub fn new(requests_per_second: NonZero<u32>) -> Self {
        let burst =
            requests_per_second.saturating_mul(const { NonZero::new(BURST_SECONDS).unwrap() });
        Self(Arc::new(RateLimiter::keyed(
            Quota::per_second(requests_per_second).allow_burst(burst),
        )))
    }

    /// How long the address has to wait; `None` if it need not wait.
    fn wait(&self, address: IpAddr) -> Option<Duration> {
        if self.0.len() > REMEMBERED {
            self.0.retain_recent();
        }
        let refused = self.0.check_key(&network(address)).err()?;
        Some(refused.wait_time_from(DefaultClock::default().now()))
    }
}

/// Refuses an address that sends too many requests.
pub async fn keep(
    State(limit): State<AddressRateLimit>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    match Remote::of(&request).address.and_then(|address| limit.wait(address)) {
        Some(wait) => Err(ApiError::TooFast { wait }),
        None => Ok(next.run(request).await),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_may_ask_for_some_seconds_at_once_and_others_are_not_held_up() {
        let limit = AddressRateLimit::new(NonZero::<u32>::MIN);
        let (one, other): (IpAddr, IpAddr) = ("10.0.0.1".parse().unwrap(), "::1".parse().unwrap());
        for _ in 0..BURST_SECONDS {
            assert_eq!(limit.wait(one), None);
        }
        let wait = limit.wait(one).unwrap();
        assert!(wait > Duration::ZERO && wait <= Duration::from_secs(1), "{wait:?}");
        assert_eq!(limit.wait(other), None);
    }
}
