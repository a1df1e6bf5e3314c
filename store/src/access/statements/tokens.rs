use std::time::Duration;

use spec::Digest;
use sqlx::types::Text;
use sqlx::{FromRow, Row};

use super::rows::digest;
use super::{Database, DbRow, Transaction, milliseconds};
use crate::{NewToken, Timestamp, Token, TokenId};

/// The columns of a token, and the current time.
macro_rules! token {
    () => {
        concat!("*, ", now!(), " AS present")
    };
}

impl Database {
    pub async fn tokens(&self) -> Result<Vec<Token>, sqlx::Error> {
        sqlx::query_as(concat!("SELECT ", token!(), " FROM token ORDER BY id"))
            .fetch_all(&self.reader)
            .await
    }

    pub async fn session(&self, session: Digest) -> Result<Option<Digest>, sqlx::Error> {
        let row = sqlx::query(concat!(
            "SELECT token FROM session WHERE digest = $1 AND expires_at > ",
            now!()
        ))
        .bind(session.to_string())
        .fetch_optional(&self.reader)
        .await?;
        row.map(|row| digest(&row, "token")).transpose()
    }
}

impl Transaction {
    pub async fn known_tokens(&mut self) -> Result<Vec<Token>, sqlx::Error> {
        sqlx::query_as(concat!("SELECT ", token!(), " FROM token ORDER BY id"))
            .fetch_all(self.connection())
            .await
    }

    /// Returns `None` when the name is taken.
    pub async fn insert_token(
        &mut self,
        token: &NewToken<'_>,
    ) -> Result<Option<Token>, sqlx::Error> {
        sqlx::query_as(concat!(
            "INSERT INTO token (name, digest, scope, created_at, expires_at) VALUES ($1, $2, $3, ",
            now!(),
            ", ",
            now!(),
            " + $4) ON CONFLICT DO NOTHING RETURNING ",
            token!()
        ))
        .bind(token.name)
        .bind(token.digest.to_string())
        .bind(token.scope.as_str())
        .bind(token.lifetime.map(milliseconds))
        .fetch_optional(self.connection())
        .await
    }

    pub async fn revoke_token(&mut self, id: TokenId) -> Result<Option<Token>, sqlx::Error> {
        sqlx::query_as(concat!(
            "UPDATE token SET revoked_at = COALESCE(revoked_at, ",
            now!(),
            ") WHERE id = $1 RETURNING ",
            token!()
        ))
        .bind(id)
        .fetch_optional(self.connection())
        .await
    }

    pub async fn delete_tokens(&mut self) -> Result<(), sqlx::Error> {
        self.execute(sqlx::query("DELETE FROM session")).await?;
        self.execute(sqlx::query("DELETE FROM token")).await
    }

    pub async fn token_used(&mut self, id: TokenId) -> Result<(), sqlx::Error> {
        let statement =
            sqlx::query(concat!("UPDATE token SET last_used_at = ", now!(), " WHERE id = $1"));
        self.execute(statement.bind(id)).await
    }

    pub async fn insert_session(
        &mut self,
        session: Digest,
        token: Digest,
        lifetime: Duration,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "INSERT INTO session (digest, token, expires_at) VALUES ($1, $2, ",
            now!(),
            " + $3)"
        ))
        .bind(session.to_string())
        .bind(token.to_string())
        .bind(milliseconds(lifetime));
        self.execute(statement).await
    }

    /// Deletes expired sessions, and all but the `keep` that last longest.
    pub async fn forget_sessions(&mut self, keep: u32) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(concat!(
            "DELETE FROM session WHERE expires_at <= ",
            now!(),
            " OR digest NOT IN (SELECT digest FROM session ORDER BY expires_at DESC, digest LIMIT $1)"
        ))
        .bind(i64::from(keep));
        self.execute(statement).await
    }

    pub async fn delete_session(&mut self, session: Digest) -> Result<(), sqlx::Error> {
        let statement = sqlx::query("DELETE FROM session WHERE digest = $1");
        self.execute(statement.bind(session.to_string())).await
    }
}

impl FromRow<'_, DbRow> for Token {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        let present: Timestamp = row.try_get("present")?;
        let expires_at: Option<Timestamp> = row.try_get("expires_at")?;
        let revoked_at: Option<Timestamp> = row.try_get("revoked_at")?;
        let Text(scope) = row.try_get("scope")?;
        Ok(Self {
            id: row.try_get("id")?,
            name: row.try_get("name")?,
            digest: digest(row, "digest")?,
            scope,
            created_at: row.try_get("created_at")?,
            expires_at,
            last_used_at: row.try_get("last_used_at")?,
            revoked_at,
            is_valid: revoked_at.is_none() && expires_at.is_none_or(|end| end > present),
        })
    }
}
