use sqlx::types::Json;
use sqlx::{FromRow, Row};

use super::rows::stored_object;
use super::{Database, DbRow, Transaction, integer};
use crate::{Artifact, RunId, StoredObject};

impl Database {
    /// Sorted by run, then by name.
    pub async fn artifacts(&self, runs: &[RunId]) -> Result<Vec<Artifact>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT * FROM artifact WHERE run IN ",
            listed_ids!("$1"),
            " \
             ORDER BY run, name"
        ))
        .bind(Json(runs))
        .fetch_all(&self.reader)
        .await
    }

    pub async fn artifacts_named(
        &self,
        runs: &[RunId],
        name: &str,
    ) -> Result<Vec<Artifact>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT * FROM artifact WHERE run IN ",
            listed_ids!("$1"),
            " AND name = $2 \
             ORDER BY run"
        ))
        .bind(Json(runs))
        .bind(name)
        .fetch_all(&self.reader)
        .await
    }

    pub async fn artifact(&self, run: RunId, name: &str) -> Result<Option<Artifact>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM artifact WHERE run = $1 AND name = $2")
            .bind(run)
            .bind(name)
            .fetch_optional(&self.reader)
            .await
    }

    /// The paths of all objects that rows name.
    pub async fn named_objects(&self) -> Result<Vec<String>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT path FROM shard_file UNION ALL SELECT path FROM checkpoint_file \
             UNION ALL SELECT path FROM artifact UNION ALL SELECT path FROM upload \
             UNION ALL SELECT path FROM tracked_artifact",
        )
        .fetch_all(&self.reader)
        .await
    }
}

impl Transaction {
    /// Returns the path of the artifact that had this name before.
    pub async fn upsert_artifact(
        &mut self,
        run: RunId,
        name: &str,
        media_type: &str,
        object: &StoredObject,
    ) -> Result<Option<String>, sqlx::Error> {
        let replaced = sqlx::query_scalar("SELECT path FROM artifact WHERE run = $1 AND name = $2")
            .bind(run)
            .bind(name)
            .fetch_optional(self.connection())
            .await?;
        sqlx::query(concat!(
            "INSERT INTO artifact (run, name, media_type, path, size, sha256, created_at) ",
            "VALUES ($1, $2, $3, $4, $5, $6, ",
            now!(),
            ") ON CONFLICT (run, name) DO UPDATE SET media_type = excluded.media_type, ",
            "path = excluded.path, size = excluded.size, sha256 = excluded.sha256, ",
            "created_at = excluded.created_at"
        ))
        .bind(run)
        .bind(name)
        .bind(media_type)
        .bind(&object.path)
        .bind(integer(object.size))
        .bind(object.sha256.to_string())
        .execute(self.connection())
        .await?;
        Ok(replaced)
    }
}

impl FromRow<'_, DbRow> for Artifact {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            run: row.try_get("run")?,
            name: row.try_get("name")?,
            media_type: row.try_get("media_type")?,
            object: stored_object(row)?,
            created_at: row.try_get("created_at")?,
        })
    }
}
