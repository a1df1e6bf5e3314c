//! The places of requests. Health, metrics, logins and administrators have places of their own, so
//! that nobody else can take them, and an address has a share of the others.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::{MatchedPath, Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::Response;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use wire::Scope;

use crate::access::{ANYONE, Identity, LOGIN, LOGOUT};
use crate::connections::Connection;
use crate::error::ApiError;
use crate::extract;
use crate::limits::{
    ADMIN_REQUESTS, CONCURRENT_LOGINS, CONCURRENT_PROBES, CONCURRENT_REQUESTS, LOGIN_BYTES,
    REQUEST_TIMEOUT,
};
use crate::remote::Remote;

/// Paths of uploads, for datasets and for artifacts of MLflow's runs.
const UPLOADS: [&str; 3] = ["/v1/datasets", "/datasets", "/robots"];
const ARTIFACTS: &str = "/api/2.0/mlflow-artifacts/artifacts/";

/// Routes by which a server is watched.
const HEALTH: [&str; 2] = ["/healthz", "/readyz"];
const METRICS: &str = "/metrics";

/// The places of all requests.
#[derive(Clone)]
pub struct RequestPlaces {
    checks: Arc<Semaphore>,
    logins: Arc<Semaphore>,
    others: Shared,
    admins: Arc<Semaphore>,
}

/// Places of which an address has a share.
#[derive(Clone)]
struct Shared {
    places: Arc<Semaphore>,
    share: usize,
    taken: Arc<Mutex<HashMap<IpAddr, usize>>>,
}

/// A place, which is free again when this is dropped.
struct Place {
    _permit: OwnedSemaphorePermit,
    _share: Option<Share>,
}

struct Share {
    network: IpAddr,
    taken: Arc<Mutex<HashMap<IpAddr, usize>>>,
}

/// The kind of a request, which decides about its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// It waits for nothing: a file of the page, or a refusal.
    Instant,
    Check,
    Login,
    Admin,
    Other,
}

impl RequestPlaces {
    /// Places for a server with so many connections. All of them, together with downloads and
    /// streams of events, are at most as many as the connections. So a new request finds a
    /// connection that gives up its place.
    pub fn new(connections: usize) -> Self {
        let part = |limit: usize, of: usize| limit.min(connections / of).max(1);
        let places = |count: usize| Arc::new(Semaphore::new(count));
        let others = part(CONCURRENT_REQUESTS, 2);
        Self {
            checks: places(part(CONCURRENT_PROBES, 32)),
            logins: places(part(CONCURRENT_LOGINS, 16)),
            others: Shared {
                places: places(others),
                share: others.div_ceil(2),
                taken: Arc::default(),
            },
            admins: places(part(ADMIN_REQUESTS, 32)),
        }
    }

    fn take(&self, kind: Kind, network: Option<IpAddr>) -> Result<Option<Place>, ApiError> {
        let own = |places: &Arc<Semaphore>| {
            let permit = Arc::clone(places).try_acquire_owned();
            permit.map(|permit| Place { _permit: permit, _share: None }).ok()
        };
        let place = match kind {
            Kind::Instant => return Ok(None),
            Kind::Check => own(&self.checks),
            Kind::Login => own(&self.logins),
            Kind::Other => self.others.take(network),
            Kind::Admin => self.others.take(network).or_else(|| own(&self.admins)),
        };
        place.map(Some).ok_or(ApiError::Crowded)
    }
}

impl Shared {
    fn take(&self, network: Option<IpAddr>) -> Option<Place> {
        let permit = Arc::clone(&self.places).try_acquire_owned().ok()?;
        let Some(network) = network else { return Some(Place { _permit: permit, _share: None }) };
        let mut taken = lock(&self.taken);
        let count = taken.entry(network).or_default();
        if *count >= self.share {
            return None;
        }
        *count += 1;
        let share = Share { network, taken: Arc::clone(&self.taken) };
        Some(Place { _permit: permit, _share: Some(share) })
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut taken = lock(&self.taken);
        if let Some(count) = taken.get_mut(&self.network) {
            *count -= 1;
            if *count == 0 {
                taken.remove(&self.network);
            }
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // No code panics while it holds the lock.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Gives a request a place. It is answered within [`REQUEST_TIMEOUT`], or told that it could not
/// be. An upload takes as long as its sender needs, and checks the time itself.
pub async fn admit(
    State(places): State<RequestPlaces>,
    mut request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    let kind = kind(&request);
    if kind == Kind::Login {
        // Anybody may send it, so it takes its place when it is here.
        request = extract::received(request, LOGIN_BYTES).await?;
    }
    let _place = places.take(kind, Remote::of(&request).network())?;
    let is_file = is_upload(&request);
    if is_file || keeps_its_connection(&request) {
        request.extensions().get::<Connection>().into_iter().for_each(Connection::keep);
    }
    if is_file {
        return Ok(next.run(request).await);
    }
    tokio::time::timeout(REQUEST_TIMEOUT, next.run(request)).await.map_err(|_| ApiError::Timeout)
}

fn kind(request: &Request) -> Kind {
    let route = request.extensions().get::<MatchedPath>().map_or("", MatchedPath::as_str);
    if HEALTH.contains(&route) {
        return Kind::Check;
    }
    if [LOGIN, LOGOUT].contains(&route) {
        return Kind::Login;
    }
    let identity = request.extensions().get::<Identity>();
    match identity.and_then(|identity| identity.caller.as_ref()) {
        None => Kind::Instant,
        Some(_) if route == METRICS => Kind::Check,
        Some(caller) if caller.scope == Scope::Admin => Kind::Admin,
        Some(_) => Kind::Other,
    }
}

fn is_upload(request: &Request) -> bool {
    let path = request.uri().path();
    let is_artifact = request.method() == Method::PUT && path.starts_with(ARTIFACTS);
    is_artifact || (request.method() == Method::POST && UPLOADS.contains(&path))
}

/// Whether the connection is never closed for another one while the body arrives.
fn keeps_its_connection(request: &Request) -> bool {
    let identity = request.extensions().get::<Identity>();
    let caller = identity.and_then(|identity| identity.caller.as_ref());
    // Without tokens everybody is an administrator.
    caller.is_some_and(|caller| caller.scope == Scope::Admin && caller.name != ANYONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> Option<IpAddr> {
        text.parse().ok()
    }

    fn taken(places: &RequestPlaces, kind: Kind, network: Option<IpAddr>) -> Vec<Place> {
        std::iter::from_fn(|| places.take(kind, network).ok().flatten()).collect()
    }

    #[test]
    fn nobody_takes_the_places_of_checks_logins_and_administrators() {
        let places = RequestPlaces::new(1024);
        let others = taken(&places, Kind::Other, None);
        assert_eq!(others.len(), 512);
        assert_eq!(taken(&places, Kind::Admin, None).len(), 32);
        assert_eq!(taken(&places, Kind::Login, None).len(), 64);
        assert_eq!(taken(&places, Kind::Check, None).len(), 16);
        assert!(places.take(Kind::Other, None).is_err());
        assert!(places.take(Kind::Instant, None).is_ok());
        drop(others);
        assert!(places.take(Kind::Other, None).is_ok());
    }

    #[test]
    fn an_address_has_half_of_the_places() {
        let places = RequestPlaces::new(1024);
        let (one, other) = (ip("192.0.2.1"), ip("192.0.2.2"));
        let of_one = taken(&places, Kind::Other, one);
        assert_eq!(of_one.len(), 256);
        assert!(places.take(Kind::Other, other).is_ok());
        assert_eq!(taken(&places, Kind::Admin, one).len(), 32, "its administrators have their own");
        drop(of_one);
        assert_eq!(taken(&places, Kind::Other, one).len(), 256);
    }

    #[test]
    fn the_places_of_a_small_server_leave_connections_for_the_rest() {
        for connections in [64, 448, 1024] {
            let places = RequestPlaces::new(connections);
            let all: usize = [Kind::Admin, Kind::Login, Kind::Check]
                .map(|kind| taken(&places, kind, None).into_iter().map(std::mem::forget).count())
                .iter()
                .sum();
            // A quarter is for events, and an eighth for downloads.
            assert!(all + connections / 4 + connections / 8 <= connections, "{connections}: {all}");
        }
    }
}
