//! Limits the rate of requests from one address.

use std::net::{IpAddr, Ipv6Addr};
use std::num::NonZero;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;
use governor::clock::{Clock as _, DefaultClock};
use governor::{DefaultKeyedRateLimiter, Quota, RateLimiter};

use crate::connections::Peer;
use crate::error::ApiError;
use crate::limits::BURST_SECONDS;

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

/// The address itself for version 4. For version 6 its network, because one machine has all
/// addresses of a network.
fn network(address: IpAddr) -> IpAddr {
    match address {
        IpAddr::V4(_) => address,
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
    }
}

/// Refuses an address that sends too many requests.
pub async fn keep(
    State(limit): State<AddressRateLimit>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    let peer = request.extensions().get::<Peer>().copied();
    match peer.and_then(|Peer(address)| limit.wait(address)) {
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

    #[test]
    fn a_network_of_version_6_is_one_machine() {
        let of = |text: &str| network(text.parse().unwrap());
        assert_eq!(of("2001:db8:1:2:3:4:5:6"), of("2001:db8:1:2::9"));
        assert_ne!(of("2001:db8:1:2::9"), of("2001:db8:1:3::9"));
        assert_ne!(of("10.0.0.1"), of("10.0.0.2"));
    }
}
