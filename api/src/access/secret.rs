//! New tokens and sessions.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

use crate::limits::TOKEN_CHARACTERS;

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
    fn a_chosen_token_is_long_and_fits_into_a_header() {
        for token in ["sixteen-letters!", "four words are ok"] {
            assert!(is_hard_to_guess(token), "{token}");
        }
        for token in ["", "x", "fifteen-letters", "ünlautiges-token-äöü", " sixteen-letters"] {
            assert!(!is_hard_to_guess(token), "{token}");
        }
        assert!(is_hard_to_guess(&super::token().unwrap()));
    }

    #[test]
    fn a_token_is_long_fit_for_a_header_and_never_the_same() {
        let token = token().unwrap();
        assert_eq!(token.len(), PREFIX.len() + 43);
        let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"-_".contains(&b);
        assert!(token.bytes().all(is_plain), "{token}");
        assert_ne!(token, super::token().unwrap());
    }
}
