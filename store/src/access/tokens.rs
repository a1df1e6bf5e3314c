//! Tokens: who may use the server, and for what. Also the sessions of browsers that logged in with
//! one.

use std::time::Duration;

use spec::Digest;
use wire::Scope;

use crate::boxed;
use crate::database::{Scope as Rows, sql};
use crate::{Store, StoreError, Timestamp, TokenId};

/// The largest number of tokens that are not revoked.
pub const MAX_TOKENS: u64 = 1000;

/// The largest number of open sessions. The oldest are closed first.
const MAX_SESSIONS: u32 = 10_000;

/// A token's record, without the token itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token {
    pub id: TokenId,
    pub name: String,
    /// SHA-256 of the token.
    pub digest: Digest,
    pub scope: Scope,
    pub created_at: Timestamp,
    pub expires_at: Option<Timestamp>,
    /// Precise to the minute.
    pub last_used_at: Option<Timestamp>,
    pub revoked_at: Option<Timestamp>,
    /// Whether it was neither revoked nor expired when it was read.
    pub is_valid: bool,
}

/// A token to be created.
#[derive(Clone, Copy, Debug)]
pub struct NewToken<'a> {
    pub name: &'a str,
    pub digest: Digest,
    pub scope: Scope,
    /// How long it is valid; `None` for ever.
    pub lifetime: Option<Duration>,
    /// Refuses to create it if no valid token, this one included, would have the scope admin.
    pub needs_an_admin: bool,
}

impl Store {
    /// # Errors
    /// [`StoreError::TokenExists`] when a token that is not revoked has the name.
    /// [`StoreError::TooManyTokens`] when there are [`MAX_TOKENS`]. [`StoreError::FirstToken`] when
    /// nobody could create another one afterwards.
    #[boxed]
    pub async fn create_token(&self, token: &NewToken<'_>) -> Result<Token, StoreError> {
        let mut tx = self.begin(Rows::Rows, "creating a token").await?;
        let known = sql!(&mut tx, known_tokens())?;
        let count = known.iter().filter(|token| token.revoked_at.is_none()).count();
        if count as u64 >= MAX_TOKENS {
            return Err(StoreError::TooManyTokens);
        }
        let can_administer = |token: &Token| token.is_valid && token.scope == Scope::Admin;
        let is_admin = token.scope == Scope::Admin || known.iter().any(can_administer);
        if token.needs_an_admin && !is_admin {
            return Err(StoreError::FirstToken { scope: token.scope });
        }
        let made = sql!(&mut tx, insert_token(token))?;
        let made = made.ok_or_else(|| StoreError::TokenExists { name: token.name.to_owned() })?;
        tx.commit().await?;
        Ok(made)
    }

    /// All tokens, including revoked and expired ones, oldest first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tokens(&self) -> Result<Vec<Token>, StoreError> {
        sql!(self.database(), "listing tokens", tokens())
    }

    /// Revokes a token. One that is revoked already stays as it is.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] when there is no such token.
    #[boxed]
    pub async fn revoke_token(&self, id: TokenId) -> Result<Token, StoreError> {
        let mut tx = self.begin(Rows::Rows, "revoking a token").await?;
        let revoked = sql!(&mut tx, revoke_token(id))?;
        let revoked = revoked.ok_or_else(|| StoreError::not_found("token", id.to_string()))?;
        tx.commit().await?;
        Ok(revoked)
    }

    /// Deletes all tokens, so that a server on this store requires none, and all sessions. Returns
    /// how many tokens there were.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn forget_tokens(&self) -> Result<u64, StoreError> {
        let mut tx = self.begin(Rows::Rows, "forgetting all tokens").await?;
        let count = sql!(&mut tx, known_tokens())?.len();
        sql!(&mut tx, delete_tokens())?;
        tx.commit().await?;
        Ok(count as u64)
    }

    /// Records that the token was used now.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn token_used(&self, id: TokenId) -> Result<(), StoreError> {
        let mut tx = self.begin(Rows::Lease, "recording the use of a token").await?;
        sql!(&mut tx, token_used(id))?;
        tx.commit().await
    }

    /// Opens a session for the token with the digest `token`.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn open_session(
        &self,
        session: Digest,
        token: Digest,
        lifetime: Duration,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Rows::Rows, "opening a session").await?;
        sql!(&mut tx, insert_session(session, token, lifetime))?;
        sql!(&mut tx, forget_sessions(MAX_SESSIONS))?;
        tx.commit().await
    }

    /// Digest of the token that this session was opened with, if the session is open.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn session(&self, session: Digest) -> Result<Option<Digest>, StoreError> {
        sql!(self.database(), "reading a session", session(session))
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn close_session(&self, session: Digest) -> Result<(), StoreError> {
        let mut tx = self.begin(Rows::Rows, "closing a session").await?;
        sql!(&mut tx, delete_session(session))?;
        tx.commit().await
    }
}
