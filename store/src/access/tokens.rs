//! Tokens: who may use the server, and for what. Also the sessions of browsers that logged in with
//! one.

use std::time::Duration;

use spec::Digest;
use wire::Scope;

use crate::database::query::{FromRow, Row, sql};
use crate::database::{Scope as Rows, Transaction};
use crate::{Store, StoreError, Timestamp, TokenId, boxed};

/// The columns of a token, and the current time.
macro_rules! token {
    () => {
        "*, {now} AS present"
    };
}

/// The largest number of tokens that are not revoked.
pub const MAX_TOKENS: u64 = 1000;

/// The largest number of open sessions. The oldest are closed first.
const MAX_SESSIONS: u32 = 10_000;

/// A token's record, without the token itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token {
    /// Its id, which never changes.
    pub id: TokenId,
    /// Its name, which no other token has until it is revoked.
    pub name: String,
    /// SHA-256 of the token.
    pub digest: Digest,
    /// The largest scope of requests that it permits.
    pub scope: Scope,
    /// When it was created.
    pub created_at: Timestamp,
    /// When it expires; `None` for never.
    pub expires_at: Option<Timestamp>,
    /// Precise to the minute.
    pub last_used_at: Option<Timestamp>,
    /// When it was revoked.
    pub revoked_at: Option<Timestamp>,
    /// Whether it was neither revoked nor expired when it was read.
    pub is_valid: bool,
}

/// A token to be created.
#[derive(Clone, Copy, Debug)]
pub struct NewToken<'a> {
    /// A name that no other token has.
    pub name: &'a str,
    /// The digest of the token. The store never learns the token itself.
    pub digest: Digest,
    /// The largest scope of requests that it permits.
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
        let known = tx.known_tokens().await?;
        let count = known.iter().filter(|token| token.revoked_at.is_none()).count();
        if count as u64 >= MAX_TOKENS {
            return Err(StoreError::TooManyTokens { allowed: MAX_TOKENS });
        }
        let can_administer = |token: &Token| token.is_valid && token.scope == Scope::Admin;
        let is_admin = token.scope == Scope::Admin || known.iter().any(can_administer);
        if token.needs_an_admin && !is_admin {
            return Err(StoreError::FirstToken { scope: token.scope });
        }
        let made = tx.insert_token(token).await?;
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
        sql(concat!("SELECT ", token!(), " FROM token ORDER BY id"))
            .all(&mut self.read("listing tokens"))
            .await
    }

    /// Revokes a token. One that is revoked already stays as it is.
    ///
    /// # Errors
    /// [`StoreError::NotFound`] when there is no such token.
    #[boxed]
    pub async fn revoke_token(&self, id: TokenId) -> Result<Token, StoreError> {
        let mut tx = self.begin(Rows::Rows, "revoking a token").await?;
        let revoked = tx.revoke_token(id).await?;
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
        let count = tx.known_tokens().await?.len();
        tx.delete_tokens().await?;
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
        tx.token_used(id).await?;
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
        tx.insert_session(session, token, lifetime).await?;
        tx.forget_sessions(MAX_SESSIONS).await?;
        tx.commit().await
    }

    /// Digest of the token that this session was opened with, if the session is open.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn session(&self, session: Digest) -> Result<Option<Digest>, StoreError> {
        let row = sql("SELECT token FROM session WHERE digest = $1 AND expires_at > {now}")
            .bind(session.to_string())
            .optional_row(&mut self.read("reading a session"))
            .await?;
        row.map(|row| row.get("token")).transpose()
    }

    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn close_session(&self, session: Digest) -> Result<(), StoreError> {
        let mut tx = self.begin(Rows::Rows, "closing a session").await?;
        tx.delete_session(session).await?;
        tx.commit().await
    }
}

impl Transaction {
    pub async fn known_tokens(&mut self) -> Result<Vec<Token>, StoreError> {
        sql(concat!("SELECT ", token!(), " FROM token ORDER BY id")).all(self).await
    }

    /// Returns `None` when the name is taken.
    pub async fn insert_token(
        &mut self,
        token: &NewToken<'_>,
    ) -> Result<Option<Token>, StoreError> {
        sql(concat!(
            "INSERT INTO token (name, digest, scope, created_at, expires_at) VALUES ($1, $2, $3, ",
            "{now}",
            ", ",
            "{now}",
            " + $4) ON CONFLICT DO NOTHING RETURNING ",
            token!()
        ))
        .bind(token.name)
        .bind(token.digest.to_string())
        .bind(token.scope)
        .bind(token.lifetime)
        .optional(self)
        .await
    }

    pub async fn revoke_token(&mut self, id: TokenId) -> Result<Option<Token>, StoreError> {
        sql(concat!(
            "UPDATE token SET revoked_at = COALESCE(revoked_at, ",
            "{now}",
            ") WHERE id = $1 RETURNING ",
            token!()
        ))
        .bind(id)
        .optional(self)
        .await
    }

    pub async fn delete_tokens(&mut self) -> Result<(), StoreError> {
        sql("DELETE FROM session").run(self).await?;
        sql("DELETE FROM token").run(self).await
    }

    pub async fn token_used(&mut self, id: TokenId) -> Result<(), StoreError> {
        sql("UPDATE token SET last_used_at = {now} WHERE id = $1").bind(id).run(self).await
    }

    pub async fn insert_session(
        &mut self,
        session: Digest,
        token: Digest,
        lifetime: Duration,
    ) -> Result<(), StoreError> {
        sql("INSERT INTO session (digest, token, expires_at) VALUES ($1, $2, {now} + $3)")
            .bind(session.to_string())
            .bind(token.to_string())
            .bind(lifetime)
            .run(self)
            .await
    }

    /// Deletes expired sessions, and all but the `keep` that last longest.
    pub async fn forget_sessions(&mut self, keep: u32) -> Result<(), StoreError> {
        sql("DELETE FROM session WHERE expires_at <= {now} OR digest NOT IN (SELECT digest \
             FROM session ORDER BY expires_at DESC, digest LIMIT $1)")
        .bind(keep)
        .run(self)
        .await
    }

    pub async fn delete_session(&mut self, session: Digest) -> Result<(), StoreError> {
        sql("DELETE FROM session WHERE digest = $1").bind(session.to_string()).run(self).await
    }
}

impl FromRow for Token {
    fn from_row(row: &Row) -> Result<Self, StoreError> {
        let present: Timestamp = row.get("present")?;
        let expires_at: Option<Timestamp> = row.get("expires_at")?;
        let revoked_at: Option<Timestamp> = row.get("revoked_at")?;
        let scope = row.get("scope")?;
        Ok(Self {
            id: row.get("id")?,
            name: row.get("name")?,
            digest: row.get("digest")?,
            scope,
            created_at: row.get("created_at")?,
            expires_at,
            last_used_at: row.get("last_used_at")?,
            revoked_at,
            is_valid: revoked_at.is_none() && expires_at.is_none_or(|end| end > present),
        })
    }
}
