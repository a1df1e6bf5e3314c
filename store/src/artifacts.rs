//! Artifacts: files that a run leaves, such as figures and reports.

use bytes::Bytes;
use spec::Digest;
use sqlx::sqlite::SqliteRow;
use sqlx::{FromRow, Row};

use crate::clock::now;
use crate::database::integer;
use crate::{Fence, RunId, Store, StoreError, StoredObject, Timestamp, jobs, leases, object_path};

#[derive(Clone, Debug)]
pub struct Artifact {
    pub run: RunId,
    pub name: String,
    /// E.g. `image/svg+xml`.
    pub media_type: String,
    pub object: StoredObject,
    pub created_at: Timestamp,
}

#[derive(Clone, Debug)]
pub struct NewArtifact<'a> {
    /// E.g. `rmse.svg`; replaces what the run has under this name.
    pub name: &'a str,
    pub media_type: &'a str,
    pub bytes: Bytes,
}

impl Store {
    /// Publishes and commits a file of the run of the fence's job.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is visible then.
    pub async fn put_artifact(
        &self,
        fence: Fence,
        artifact: NewArtifact<'_>,
    ) -> Result<(), StoreError> {
        const OPERATION: &str = "committing an artifact";
        let failed = StoreError::database(OPERATION);
        let mut conn = self.database().reader().acquire().await.map_err(&failed)?;
        let run = leases::check_run(&mut conn, fence).await?;
        drop(conn);
        let digest = Digest::of(&artifact.bytes);
        let path = object_path::artifact(run, fence.epoch, &digest, artifact.name);
        let object = self.put_object(&path, artifact.bytes).await?;

        let mut tx = self.database().write(OPERATION).await?;
        leases::check(&mut tx, fence).await?;
        let replaced: Option<String> =
            sqlx::query_scalar("SELECT path FROM artifact WHERE run = ? AND name = ?")
                .bind(run)
                .bind(artifact.name)
                .fetch_optional(&mut *tx)
                .await
                .map_err(&failed)?;
        sqlx::query(concat!(
            "INSERT INTO artifact (run, name, media_type, path, size, sha256, created_at) ",
            "VALUES (?, ?, ?, ?, ?, ?, ",
            now!(),
            ") ON CONFLICT (run, name) DO UPDATE SET media_type = excluded.media_type, ",
            "path = excluded.path, size = excluded.size, sha256 = excluded.sha256, ",
            "created_at = excluded.created_at"
        ))
        .bind(run)
        .bind(artifact.name)
        .bind(artifact.media_type)
        .bind(&object.path)
        .bind(integer(object.size))
        .bind(object.sha256.to_string())
        .execute(&mut *tx)
        .await
        .map_err(&failed)?;
        tx.commit().await.map_err(&failed)?;
        self.objects().delete(replaced.into_iter().filter(|old| *old != path).collect()).await;
        Ok(())
    }

    /// By name.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn artifacts(&self, run: RunId) -> Result<Vec<Artifact>, StoreError> {
        sqlx::query_as("SELECT * FROM artifact WHERE run = ? ORDER BY name")
            .bind(run)
            .fetch_all(self.database().reader())
            .await
            .map_err(StoreError::database("reading a run's artifacts"))
    }

    /// # Errors
    /// When the run has no artifact of this name.
    pub async fn artifact(&self, run: RunId, name: &str) -> Result<Artifact, StoreError> {
        sqlx::query_as("SELECT * FROM artifact WHERE run = ? AND name = ?")
            .bind(run)
            .bind(name)
            .fetch_optional(self.database().reader())
            .await
            .map_err(StoreError::database("reading an artifact"))?
            .ok_or_else(|| StoreError::not_found("artifact", format!("{name} of run {run}")))
    }
}

impl FromRow<'_, SqliteRow> for Artifact {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            run: row.try_get("run")?,
            name: row.try_get("name")?,
            media_type: row.try_get("media_type")?,
            object: stored_object(row)?,
            created_at: row.try_get("created_at")?,
        })
    }
}

/// From the columns `path`, `size` and `sha256`.
pub(crate) fn stored_object(row: &SqliteRow) -> Result<StoredObject, sqlx::Error> {
    Ok(StoredObject {
        path: row.try_get("path")?,
        size: row.try_get("size")?,
        sha256: jobs::digest(row, "sha256")?,
    })
}
