//! The credentials of a request: a token, or a browser's session. New ones of both.

use axum::http::HeaderMap;
use axum::http::header::{AUTHORIZATION, COOKIE};
use base64::Engine as _;
use base64::engine::general_purpose::{STANDARD as BASE64, URL_SAFE_NO_PAD};
use spec::Digest;

use crate::limits::TOKEN_CHARACTERS;

/// The cookie of a logged-in browser.
pub const SESSION_COOKIE: &str = "torqued_session";

/// Credentials as digests. Comparing digests takes the same time wherever they differ, and reading
/// the database reveals no token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Credentials {
    None,
    /// An `Authorization` without a token, or a cookie without a session.
    Unreadable,
    Token(Digest),
    Session(Digest),
}

impl Credentials {
    pub fn of(headers: &HeaderMap) -> Self {
        if let Some(value) = headers.get(AUTHORIZATION) {
            let token = value.to_str().ok().and_then(token);
            return token.map_or(Self::Unreadable, |token| Self::Token(digest(&token)));
        }
        session(headers).map_or(Self::None, |session| Self::Session(digest(session)))
    }
}

/// The digest that identifies a token or a session.
pub fn digest(secret: &str) -> Digest {
    Digest::of(secret.as_bytes())
}

/// The token in `Bearer TOKEN`, or the password in `Basic`, so that curl and browsers can send it.
fn token(credentials: &str) -> Option<String> {
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

/// The session of a browser's cookie.
pub fn session(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs =
        cookies.flat_map(|cookies| cookies.split(';')).filter_map(|cookie| cookie.split_once('='));
    let (_, session) = pairs.find(|(name, _)| name.trim() == SESSION_COOKIE)?;
    Some(session.trim())
}

/// The prefix by which people and scanners for leaked secrets recognize a token.
const PREFIX: &str = "torqued_";

/// Whether a token that a person chose is long enough, and has only characters that a header can
/// carry.
pub fn is_hard_to_guess(token: &str) -> bool {
    let is_plain = token.bytes().all(|byte| byte.is_ascii_graphic() || byte == b' ');
    token.len() >= TOKEN_CHARACTERS && is_plain && token.trim() == token
}

/// A new token: the prefix and 256 random bits.
///
/// # Errors
/// When the operating system gives no random bits.
pub fn new_token() -> Result<String, getrandom::Error> {
    Ok(format!("{PREFIX}{}", new_session()?))
}

/// A new session: 256 random bits.
pub fn new_session() -> Result<String, getrandom::Error> {
    let mut bits = [0; 32];
    getrandom::fill(&mut bits)?;
    Ok(URL_SAFE_NO_PAD.encode(bits))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn credentials(name: &'static str, value: &str) -> Credentials {
        Credentials::of(&HeaderMap::from_iter([(name.parse().unwrap(), value.parse().unwrap())]))
    }

    #[test]
    fn a_token_comes_as_bearer_or_as_the_password_of_basic() {
        let secret = Credentials::Token(digest("secret"));
        let basic = format!("Basic {}", BASE64.encode("anyone:secret"));
        for value in ["Bearer secret", "bearer secret", &basic] {
            assert_eq!(credentials("authorization", value), secret);
        }
        for value in ["secret", "Digest secret", "Basic !"] {
            assert_eq!(credentials("authorization", value), Credentials::Unreadable, "{value}");
        }
        assert_ne!(credentials("authorization", "Bearer secret2"), secret);
    }

    #[test]
    fn a_session_comes_as_a_cookie_among_others() {
        let session = Credentials::Session(digest("s1"));
        assert_eq!(credentials("cookie", "theme=dark; torqued_session=s1; a=b"), session);
        assert_eq!(credentials("cookie", "torqued_session=s1"), session);
        for value in ["theme=dark", "xtorqued_session=s1", ""] {
            assert_eq!(credentials("cookie", value), Credentials::None, "{value}");
        }
    }

    #[test]
    fn a_chosen_token_is_long_and_fits_into_a_header() {
        for token in ["sixteen-letters!", "four words are ok"] {
            assert!(is_hard_to_guess(token), "{token}");
        }
        for token in ["", "x", "fifteen-letters", "ünlautiges-token-äöü", " sixteen-letters"] {
            assert!(!is_hard_to_guess(token), "{token}");
        }
        assert!(is_hard_to_guess(&new_token().unwrap()));
    }

    #[test]
    fn a_token_is_long_fit_for_a_header_and_never_the_same() {
        let token = new_token().unwrap();
        assert_eq!(token.len(), PREFIX.len() + 43);
        let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"-_".contains(&b);
        assert!(token.bytes().all(is_plain), "{token}");
        assert_ne!(token, new_token().unwrap());
    }
}
