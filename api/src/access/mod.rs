//! Access control: tokens and sessions with their scopes, and guards against other sites' pages.
//!
//! A server is *open* as long as it was started without a token and its store has none. It then
//! listens only on loopback, where the danger is a web page in the user's own browser. Two guards
//! protect an open server. State-changing requests from another site are refused
//! ([`tower_http::csrf`]). Requests addressed to a name that is not loopback are refused too,
//! because DNS rebinding uses such names. With a token neither attack works anyway, and a proxy may
//! use any name.

mod callers;
pub mod credentials;
mod failures;
mod scopes;
mod tokens;

use std::net::IpAddr;

use axum::extract::{MatchedPath, Request, State};
use axum::http::header::{ACCEPT, HOST, LOCATION};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Redirect, Response};
use wire::Scope;

use crate::error::ApiError;
use crate::limits::REQUEST_TIMEOUT;
use crate::remote::Remote;

pub(crate) use callers::{ANYONE, Access, NOBODY, SERVERS_TOKEN};
pub use callers::{
    Caller, asked_for_a_token, caller_name, logged_in_as, may_administer, may_submit, seen_by,
};
pub use credentials::Credentials;
pub use scopes::Scopes;

/// Routes that reveal almost nothing and so need no token.
const OPEN_ROUTES: [&str; 5] = ["/healthz", "/readyz", "/static/{name}", LOGIN, LOGOUT];

/// The path of the login form.
pub const LOGIN: &str = "/login";

pub const LOGOUT: &str = "/logout";

/// The sender of a request, before anything is decided about it.
#[derive(Clone)]
pub struct Identity {
    offered: Credentials,
    /// `None` if the credentials are not valid.
    pub caller: Option<Caller>,
}

/// Finds out who sends a request. Nobody looks at the token of a client that failed too often, unless
/// the token was right before.
pub async fn identify(
    State(access): State<Access>,
    mut request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    if is_open_route(&request) {
        return Ok(next.run(request).await);
    }
    let offered = Credentials::of(request.headers());
    let network = Remote::of(&request).network();
    if let Credentials::Token(token) = offered
        && let Some(wait) = access.failures().wait(network)
        && !access.failures().is_proven(network, token)
    {
        return Err(ApiError::TooManyFailures { wait });
    }
    let caller = tokio::time::timeout(REQUEST_TIMEOUT, access.caller(offered)).await;
    let caller = caller.map_err(|_| ApiError::Timeout)??;
    if let (Credentials::Token(token), Some(caller)) = (offered, &caller)
        && caller.name != ANYONE
    {
        access.failures().prove(network, token);
    }
    request.extensions_mut().insert(Identity { offered, caller });
    Ok(next.run(request).await)
}

fn is_open_route(request: &Request) -> bool {
    let route = request.extensions().get::<MatchedPath>().map(MatchedPath::as_str);
    route.is_some_and(|route| OPEN_ROUTES.contains(&route))
}

/// Accepts a request if its caller may send it, and records changes in the audit log.
pub async fn require_scope(
    State((access, scopes)): State<(Access, Scopes)>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    if is_open_route(&request) {
        return Ok(next.run(request).await);
    }
    let Some(Identity { offered, caller }) = request.extensions().get::<Identity>().cloned() else {
        return Err(ApiError::Internal);
    };
    let route = request.extensions().get::<MatchedPath>().map(MatchedPath::as_str);
    let needed = scopes.needed(route, request.method());
    let Some(caller) = caller else {
        if is_for_a_page(&request, offered) {
            return Ok(to_login(&request));
        }
        if matches!(offered, Credentials::Token(_)) {
            let remote = Remote::of(&request);
            access.record_failure(remote, request.method(), request.uri()).await;
        }
        return Err(ApiError::Unauthorized { offered: offered != Credentials::None });
    };
    if needed == Scope::Read || (caller.scope >= needed && !scopes::is_recorded(route)) {
        return Ok(answered(caller, request, next).await);
    }
    let mut entry =
        callers::entry(&caller.name, Remote::of(&request), request.method(), request.uri());
    let response = if caller.scope < needed {
        let token = caller.name.clone();
        let refusal = ApiError::Scope { token, scope: caller.scope, needed };
        with_caller(refusal.into_response(), caller)
    } else {
        answered(caller, request, next).await
    };
    entry.status = response.status().as_u16();
    let made = response.headers().get(LOCATION).and_then(|path| path.to_str().ok());
    entry.made = made.map(str::to_owned);
    access.record(&entry).await;
    Ok(response)
}

async fn answered(caller: Caller, request: Request, next: Next) -> Response {
    let response = callers::CALLER.scope(caller.clone(), next.run(request)).await;
    with_caller(response, caller)
}

/// The response, which says to outer layers who asked.
fn with_caller(mut response: Response, caller: Caller) -> Response {
    response.extensions_mut().insert(caller);
    response
}

/// Prefixes of paths that are not pages.
const NO_PAGES: [&str; 3] = ["/v1/", "/api/", "/metrics"];

/// Whether a browser without a login asks for a page.
fn is_for_a_page(request: &Request, offered: Credentials) -> bool {
    let has_token = matches!(offered, Credentials::Token(_) | Credentials::Unreadable);
    request.method() == Method::GET && !has_token && wants_a_page(request)
}

/// Whether a browser sends a request to a path of the page.
pub fn wants_a_page(request: &Request) -> bool {
    let path = request.uri().path();
    let is_page = !NO_PAGES.iter().any(|beginning| path.starts_with(beginning));
    is_page && accepts_html(request.headers())
}

pub fn accepts_html(headers: &HeaderMap) -> bool {
    let accept = headers.get(ACCEPT).map(HeaderValue::to_str);
    matches!(accept, Some(Ok(accept)) if accept.contains("text/html"))
}

/// Redirects a browser to the login, which leads back afterwards.
fn to_login(request: &Request) -> Response {
    let path = request.uri().path_and_query().map_or("/", |path| path.as_str());
    let back = form_urlencoded::byte_serialize(path.as_bytes()).collect::<String>();
    Redirect::to(&format!("{LOGIN}?back={back}")).into_response()
}

pub async fn require_loopback_name(
    State(access): State<Access>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    if !access.is_open().await? {
        return Ok(next.run(request).await);
    }
    let header = request.headers().get(HOST).map(|value| value.to_str().unwrap_or("").to_owned());
    let target = request.uri().authority().map(Authority::to_string);
    for name in header.into_iter().chain(target) {
        if !is_loopback(&name) {
            return Err(ApiError::ForeignHost { name });
        }
    }
    Ok(next.run(request).await)
}

/// Whether `authority`, a host with or without a port, is this machine's loopback.
fn is_loopback(authority: &str) -> bool {
    let Ok(authority) = authority.parse::<Authority>() else { return false };
    let host = authority.host();
    let address = host.trim_start_matches('[').trim_end_matches(']');
    match address.parse::<IpAddr>() {
        Ok(address) => address.is_loopback(),
        Err(_) => host.eq_ignore_ascii_case("localhost"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_names_are_loopback() {
        for name in ["localhost", "LOCALHOST:7070", "127.0.0.1:7070", "127.9.9.9", "[::1]:80"] {
            assert!(is_loopback(name), "{name}");
        }
        for name in ["", "evil.example", "localhost.evil.example", "10.0.0.1:7070", "[::2]", "a b"]
        {
            assert!(!is_loopback(name), "{name}");
        }
    }
}
