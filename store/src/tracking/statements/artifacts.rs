use sqlx::types::Json;
use sqlx::{FromRow, Row};

use super::rows::stored_object;
use super::{Database, DbRow, Transaction, integer};
use crate::{StoredObject, TrackedArtifact, TrackedRunId};

impl Database {
    /// Sorted by name.
    pub async fn tracked_artifacts(
        &self,
        run: TrackedRunId,
    ) -> Result<Vec<TrackedArtifact>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM tracked_artifact WHERE run = $1 ORDER BY name")
            .bind(run)
            .fetch_all(&self.reader)
            .await
    }

    pub async fn tracked_artifact(
        &self,
        run: TrackedRunId,
        name: &str,
    ) -> Result<Option<TrackedArtifact>, sqlx::Error> {
        sqlx::query_as("SELECT * FROM tracked_artifact WHERE run = $1 AND name = $2")
            .bind(run)
            .bind(name)
            .fetch_optional(&self.reader)
            .await
    }
}

impl Transaction {
    /// Returns the path of the artifact that had this name before.
    pub async fn upsert_tracked_artifact(
        &mut self,
        run: TrackedRunId,
        name: &str,
        object: &StoredObject,
    ) -> Result<Option<String>, sqlx::Error> {
        let replaced =
            sqlx::query_scalar("SELECT path FROM tracked_artifact WHERE run = $1 AND name = $2")
                .bind(run)
                .bind(name)
                .fetch_optional(self.connection())
                .await?;
        sqlx::query(concat!(
            "INSERT INTO tracked_artifact (run, name, path, size, sha256, created_at) ",
            "VALUES ($1, $2, $3, $4, $5, ",
            now!(),
            ") ON CONFLICT (run, name) DO UPDATE SET path = excluded.path, ",
            "size = excluded.size, sha256 = excluded.sha256, created_at = excluded.created_at"
        ))
        .bind(run)
        .bind(name)
        .bind(&object.path)
        .bind(integer(object.size))
        .bind(object.sha256.to_string())
        .execute(self.connection())
        .await?;
        Ok(replaced)
    }

    /// Returns the paths of the artifacts' objects.
    pub async fn delete_tracked_artifacts(
        &mut self,
        run: TrackedRunId,
        names: &[String],
    ) -> Result<Vec<String>, sqlx::Error> {
        sqlx::query_scalar(concat!(
            "DELETE FROM tracked_artifact WHERE run = $1 AND name IN ",
            listed_texts!("$2"),
            " RETURNING path"
        ))
        .bind(run)
        .bind(Json(names))
        .fetch_all(self.connection())
        .await
    }
}

impl FromRow<'_, DbRow> for TrackedArtifact {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            name: row.try_get("name")?,
            object: stored_object(row)?,
            created_at: row.try_get("created_at")?,
        })
    }
}
