//! New tokens and sessions.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

/// The prefix by which people and scanners for leaked secrets recognize a token.
const PREFIX: &str = "torqued_";

/// A new token: the prefix and 256 random bits.
///
/// # Errors
/// When the operating system gives no random bits.
pub fn token() -> Result<String, getrandom::Error> {
    Ok(format!("{PREFIX}{}", session()?))
}

/// A new session: 256 random bits.
pub fn session() -> Result<String, getrandom::Error> {
    let mut bits = [0; 32];
    getrandom::fill(&mut bits)?;
    Ok(URL_SAFE_NO_PAD.encode(bits))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_long_fit_for_a_header_and_never_the_same() {
        let token = token().unwrap();
        assert_eq!(token.len(), PREFIX.len() + 43);
        let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"-_".contains(&b);
        assert!(token.bytes().all(is_plain), "{token}");
        assert_ne!(token, super::token().unwrap());
    }
}
