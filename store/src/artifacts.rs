//! Artifacts: files that a run leaves, such as figures and reports.

use std::collections::BTreeMap;

use arrow::array::RecordBatch;
use bytes::Bytes;
use spec::Digest;
use sqlx::sqlite::SqliteRow;
use sqlx::{FromRow, Row};

use crate::clock::now;
use crate::database::integer;
use crate::{Fence, RunId, Store, StoreError, StoredObject, Timestamp, jobs, leases, object_path};

const COMMIT: &str = "committing an artifact";

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
    /// E.g. `rmse-multisine.svg`; replaces what the run has under this name.
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
        let run = self.run_of(fence).await?;
        let digest = Digest::of(&artifact.bytes);
        let path = object_path::artifact(run, fence.epoch, &digest, artifact.name);
        let object = self.put_object(&path, artifact.bytes).await?;
        self.commit_artifact(fence, run, artifact.name, artifact.media_type, &object).await
    }

    /// Writes, publishes and commits a Parquet table as a file of the run of the fence's job, which
    /// it returns. `footer` goes into the file's key-value metadata.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is visible then. A full disk.
    pub async fn put_table(
        &self,
        fence: Fence,
        name: &str,
        batches: Vec<RecordBatch>,
        footer: &BTreeMap<String, String>,
    ) -> Result<RunId, StoreError> {
        let run = self.run_of(fence).await?;
        let Some(schema) = batches.first().map(RecordBatch::schema) else { return Ok(run) };
        let path = object_path::table(run, fence.epoch, name);
        let mut writer = self.write_table(&path, schema, footer).await?;
        let written = tokio::task::spawn_blocking(move || {
            batches.into_iter().try_for_each(|batch| writer.write(batch))?;
            writer.finish()
        });
        let object = written
            .await
            .map_err(|error| StoreError::file("writing", &path)(std::io::Error::other(error)))??;
        self.commit_artifact(fence, run, name, "application/vnd.apache.parquet", &object).await?;
        Ok(run)
    }

    async fn run_of(&self, fence: Fence) -> Result<RunId, StoreError> {
        let failed = StoreError::database(COMMIT);
        let mut conn = self.database().reader().acquire().await.map_err(&failed)?;
        leases::check_run(&mut conn, fence).await
    }

    /// The row that makes a published object an artifact.
    async fn commit_artifact(
        &self,
        fence: Fence,
        run: RunId,
        name: &str,
        media_type: &str,
        object: &StoredObject,
    ) -> Result<(), StoreError> {
        let failed = StoreError::database(COMMIT);
        let mut tx = self.database().write(COMMIT).await?;
        leases::check(&mut tx, fence).await?;
        let replaced: Option<String> =
            sqlx::query_scalar("SELECT path FROM artifact WHERE run = ? AND name = ?")
                .bind(run)
                .bind(name)
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
        .bind(name)
        .bind(media_type)
        .bind(&object.path)
        .bind(integer(object.size))
        .bind(object.sha256.to_string())
        .execute(&mut *tx)
        .await
        .map_err(&failed)?;
        tx.commit().await.map_err(&failed)?;
        let outdated = replaced.into_iter().filter(|old| *old != object.path).collect();
        self.objects().delete(outdated).await;
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
