use spec::Digest;
use sqlx::{FromRow, Row};

use super::rows::stored_object;
use super::{Database, DbRow, Transaction, integer};
use crate::{StoredObject, Upload};

impl Database {
    pub async fn upload(&self, sha256: Digest) -> Result<Option<Upload>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM upload WHERE sha256 = $1")
            .bind(sha256.to_string())
            .fetch_optional(&self.reader)
            .await
    }

    pub async fn newest_uploads(&self, limit: u32) -> Result<Vec<Upload>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM upload ORDER BY created_at DESC, sha256 LIMIT $1")
            .bind(i64::from(limit))
            .fetch_all(&self.reader)
            .await
    }
}

impl Transaction {
    pub async fn known_upload(&mut self, sha256: Digest) -> Result<Option<Upload>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM upload WHERE sha256 = $1")
            .bind(sha256.to_string())
            .fetch_optional(self.connection())
            .await
    }

    /// An existing row has lost its object, so it gets this one.
    pub async fn insert_upload(
        &mut self,
        name: &str,
        object: &StoredObject,
    ) -> Result<Upload, sqlx::Error> {
        sqlx::query_as(concat!(
            "INSERT INTO upload (sha256, name, path, size, created_at) VALUES ($1, $2, $3, $4, ",
            now!(),
            ") ON CONFLICT (sha256) DO UPDATE SET path = excluded.path RETURNING *"
        ))
        .bind(object.sha256.to_string())
        .bind(name)
        .bind(&object.path)
        .bind(integer(object.size))
        .fetch_one(self.connection())
        .await
    }
}

impl FromRow<'_, DbRow> for Upload {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            name: row.try_get("name")?,
            object: stored_object(row)?,
            created_at: row.try_get("created_at")?,
        })
    }
}
