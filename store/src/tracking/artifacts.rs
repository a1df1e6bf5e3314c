//! Files of tracked runs.

use crate::database::column::json;
use crate::database::query::{from_row, sql};
use crate::database::{Reading, Scope, Transaction};
use crate::objects::path;
use crate::tracking::runs::active_run;
use crate::{
    Store, StoreError, StoredObject, Timestamp, TrackedRun, TrackedRunId, UploadWriter, boxed,
};

/// A file that a client has logged with a tracked run.
#[derive(Clone, Debug)]
pub struct TrackedArtifact {
    /// The name, with slashes between folders, e.g. `plots/loss.svg`.
    pub name: String,
    /// Its bytes.
    pub object: StoredObject,
    /// When it was last sent.
    pub created_at: Timestamp,
}

const READING: &str = "reading artifacts of a tracked run";

impl Store {
    /// Begins to receive a file of a run.
    ///
    /// # Errors
    /// When the disk is full or fails.
    #[boxed]
    pub async fn begin_tracked_artifact(
        &self,
        run: &TrackedRun,
    ) -> Result<UploadWriter, StoreError> {
        self.receive(&path::tracked_artifact(run.id)).await
    }

    /// The artifacts of a run, sorted by name.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn tracked_artifacts(
        &self,
        run: TrackedRunId,
    ) -> Result<Vec<TrackedArtifact>, StoreError> {
        sql("SELECT * FROM tracked_artifact WHERE run = $1 ORDER BY name")
            .bind(run)
            .all(&mut self.read(READING))
            .await
    }

    /// # Errors
    /// When the run has no artifact of this name.
    #[boxed]
    pub async fn tracked_artifact(
        &self,
        run: &TrackedRun,
        name: &str,
    ) -> Result<TrackedArtifact, StoreError> {
        self.read(READING).tracked_artifact(run.id, name).await?.ok_or_else(|| {
            StoreError::not_found("artifact", format!("{name} of run {}", run.identifier))
        })
    }

    /// Deletes the artifacts with these names.
    ///
    /// # Errors
    /// When there is no such run, or it is deleted.
    #[boxed]
    pub async fn delete_tracked_artifacts(
        &self,
        run: &str,
        names: &[String],
    ) -> Result<(), StoreError> {
        let mut tx = self.begin(Scope::Rows, "deleting artifacts of a tracked run").await?;
        let run = active_run(&mut tx, run).await?;
        let paths = tx.delete_tracked_artifacts(run.id, names).await?;
        tx.commit().await?;
        self.objects().delete(paths).await;
        Ok(())
    }
}

impl UploadWriter {
    /// Syncs, publishes and commits the received bytes as a file of a run. They replace the run's
    /// file with the same name.
    ///
    /// # Errors
    /// When there is no such run, or it is deleted. When the disk is full or fails.
    #[boxed]
    pub async fn finish_as_artifact(self, run: &str, name: &str) -> Result<(), StoreError> {
        let (store, object) = self.into_object().await?;
        store.objects().verify_published(&object).await?;
        let mut tx = store.begin(Scope::Rows, "committing an artifact of a tracked run").await?;
        let run = active_run(&mut tx, run).await?;
        let replaced = tx.upsert_tracked_artifact(run.id, name, &object).await?;
        tx.commit().await?;
        store.objects().delete(replaced.into_iter().collect()).await;
        Ok(())
    }
}

impl Reading<'_> {
    pub async fn tracked_artifact(
        &mut self,
        run: TrackedRunId,
        name: &str,
    ) -> Result<Option<TrackedArtifact>, StoreError> {
        sql("SELECT * FROM tracked_artifact WHERE run = $1 AND name = $2")
            .bind(run)
            .bind(name)
            .optional(self)
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
    ) -> Result<Option<String>, StoreError> {
        let replaced = sql("SELECT path FROM tracked_artifact WHERE run = $1 AND name = $2")
            .bind(run)
            .bind(name)
            .optional(self)
            .await?;
        sql("INSERT INTO tracked_artifact (run, name, path, size, sha256, created_at) \
             VALUES ($1, $2, $3, $4, $5, {now}) ON CONFLICT (run, name) DO UPDATE \
             SET path = excluded.path, size = excluded.size, sha256 = excluded.sha256, \
             created_at = excluded.created_at")
        .bind(run)
        .bind(name)
        .bind(&object.path)
        .bind(object.size)
        .bind(object.sha256.to_string())
        .changed(self)
        .await?;
        Ok(replaced)
    }

    /// Returns the paths of the artifacts' objects.
    pub async fn delete_tracked_artifacts(
        &mut self,
        run: TrackedRunId,
        names: &[String],
    ) -> Result<Vec<String>, StoreError> {
        sql("DELETE FROM tracked_artifact WHERE run = $1 AND name IN {texts $2} RETURNING path")
            .bind(run)
            .bind(json(&names))
            .all(self)
            .await
    }
}

from_row!(TrackedArtifact { name, created_at, ..row => object: StoredObject::from_row(row)? });
