//! Tokens: lists, creates and revokes them.

use std::time::Duration;

use store::{Timestamp, TokenId};
use wire::{CreatedToken, NewToken, Token, Tokens};

use crate::access::{ANYONE, NOBODY, SERVERS_TOKEN, credentials};
use crate::app::App;
use crate::app::questions::RequestViolations;
use crate::error::ApiError;
use crate::limits::{TOKEN_LIFETIME_S, TOKEN_NAME_BYTES};

impl App {
    /// All tokens, oldest first, with those that are revoked or expired.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn tokens(&self) -> Result<Tokens, ApiError> {
        let tokens = self.store.tokens().await?;
        Ok(Tokens { tokens: tokens.into_iter().map(about).collect() })
    }

    /// Creates a token. The answer has its secret, which is not stored.
    ///
    /// # Errors
    /// When the name or the lifetime is not allowed, the name is taken, there are too many tokens,
    /// or nobody could create another one.
    pub async fn create_token(&self, asked: &NewToken) -> Result<CreatedToken, ApiError> {
        check(asked)?;
        let secret = credentials::new_token()?;
        let token = store::NewToken {
            name: &asked.name,
            digest: credentials::digest(&secret),
            scope: asked.scope,
            lifetime: asked.expires_in_s.map(Duration::from_secs),
            needs_an_admin: !self.access.has_own_token(),
        };
        let token = about(self.store.create_token(&token).await?);
        self.access.forget_tokens();
        Ok(CreatedToken { secret, token })
    }

    /// Revokes a token. The server refuses it from now on.
    ///
    /// # Errors
    /// When there is no such token.
    pub async fn revoke_token(&self, id: i64) -> Result<Token, ApiError> {
        let token = about(self.store.revoke_token(TokenId(id)).await?);
        self.access.forget_tokens();
        Ok(token)
    }
}

/// The allowed names of tokens, in words.
pub const TOKEN_NAMES: &str = "1 to 100 letters, digits, dashes, underscores, dots and @";

/// Whether a token may have this name.
pub fn is_token_name(name: &str) -> bool {
    let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.@".contains(&b);
    (1..=TOKEN_NAME_BYTES).contains(&name.len()) && name.bytes().all(is_plain)
}

fn check(asked: &NewToken) -> Result<(), ApiError> {
    let NewToken { name, scope: _, expires_in_s } = asked;
    let mut violations = RequestViolations::default();
    if !is_token_name(name) {
        violations.add("name", name, TOKEN_NAMES);
    }
    if [ANYONE, NOBODY, SERVERS_TOKEN].contains(&name.as_str()) {
        violations.add("name", name, "a name without another meaning in the audit log");
    }
    let (shortest, longest) = TOKEN_LIFETIME_S;
    if let Some(seconds) = expires_in_s
        && !(shortest..=longest).contains(seconds)
    {
        violations.add("expires_in_s", seconds, format!("{shortest} to {longest}, or left out"));
    }
    violations.finish_as(ApiError::NewToken)
}

fn about(token: store::Token) -> Token {
    let text = |moment: Option<Timestamp>| moment.map(|moment| moment.to_string());
    Token {
        id: token.id.0,
        name: token.name,
        scope: token.scope,
        valid: token.is_valid,
        created_at: token.created_at.to_string(),
        expires_at: text(token.expires_at),
        last_used_at: text(token.last_used_at),
        revoked_at: text(token.revoked_at),
    }
}
