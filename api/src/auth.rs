//! Who may ask: a bearer token when there is one, and never another site's page.
//!
//! Without a token the server only listens on loopback, where the danger is a web page in the
//! user's own browser. Two guards stand against it: state-changing requests from another site are
//! refused ([`tower_http::csrf`]), and so are requests addressed to a name that is not loopback,
//! which is how DNS rebinding shows itself. With a token neither could get in anyway, and a proxy
//! may use any name.

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, HOST};
use axum::http::uri::Authority;
use axum::middleware::Next;
use axum::response::Response;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use spec::Digest;
use subtle::ConstantTimeEq;

use crate::app::App;
use crate::error::ApiError;

/// The paths that tell next to nothing and so need no token.
const OPEN_PATHS: [&str; 2] = ["/healthz", "/readyz"];

/// The token, as its digest: comparing digests takes the same time wherever they differ, for
/// tokens of any length.
#[derive(Clone)]
pub struct Token(Digest);

impl Token {
    pub fn new(token: &str) -> Self {
        Self(Digest::of(token.as_bytes()))
    }

    fn matches(&self, offered: &str) -> bool {
        let offered = Digest::of(offered.as_bytes());
        self.0.as_bytes().ct_eq(offered.as_bytes()).into()
    }
}

pub async fn require_token(
    State(app): State<App>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    let Some(token) = app.token() else { return Ok(next.run(request).await) };
    let credentials = request.headers().get(AUTHORIZATION).and_then(|value| value.to_str().ok());
    let accepted = credentials.and_then(offered_token).is_some_and(|it| token.matches(&it));
    if accepted || OPEN_PATHS.contains(&request.uri().path()) {
        return Ok(next.run(request).await);
    }
    Err(ApiError::Unauthorized { offered: credentials.is_some() })
}

/// The token of `Bearer TOKEN`, or of `Basic` as its password, which is how a browser that opens
/// the page can send it.
fn offered_token(credentials: &str) -> Option<String> {
    let (scheme, value) = credentials.split_once(' ')?;
    if scheme.eq_ignore_ascii_case("bearer") {
        return Some(value.trim().to_owned());
    }
    if !scheme.eq_ignore_ascii_case("basic") {
        return None;
    }
    let decoded = String::from_utf8(BASE64.decode(value.trim()).ok()?).ok()?;
    let (_user, password) = decoded.split_once(':')?;
    Some(password.to_owned())
}

pub async fn require_loopback_name(
    State(app): State<App>,
    request: Request,
    next: Next,
) -> Result<Response, ApiError> {
    if app.token().is_some() {
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

    #[test]
    fn a_token_comes_as_bearer_or_as_the_password_of_basic() {
        let token = Token::new("secret");
        let basic = format!("Basic {}", BASE64.encode("anyone:secret"));
        for credentials in ["Bearer secret", "bearer secret", &basic] {
            assert!(offered_token(credentials).is_some_and(|it| token.matches(&it)));
        }
        for credentials in ["Bearer secre", "Bearer secret2", "secret", "Digest secret", "Basic !"]
        {
            assert!(!offered_token(credentials).is_some_and(|it| token.matches(&it)));
        }
    }
}
