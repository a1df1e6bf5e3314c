//! Files of tracked runs.

use crate::boxed;
use crate::database::{Scope, sql};
use crate::objects::path;
use crate::tracking::runs::active_run;
use crate::{Store, StoreError, StoredObject, Timestamp, TrackedRun, TrackedRunId, UploadWriter};

#[derive(Clone, Debug)]
pub struct TrackedArtifact {
    /// The name, with slashes between folders, e.g. `plots/loss.svg`.
    pub name: String,
    pub object: StoredObject,
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
        sql!(self.database(), READING, tracked_artifacts(run))
    }

    /// # Errors
    /// When the run has no artifact of this name.
    #[boxed]
    pub async fn tracked_artifact(
        &self,
        run: &TrackedRun,
        name: &str,
    ) -> Result<TrackedArtifact, StoreError> {
        sql!(self.database(), READING, tracked_artifact(run.id, name))?.ok_or_else(|| {
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
        let paths = sql!(&mut tx, delete_tracked_artifacts(run.id, names))?;
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
        let replaced = sql!(&mut tx, upsert_tracked_artifact(run.id, name, &object))?;
        tx.commit().await?;
        store.objects().delete(replaced.into_iter().collect()).await;
        Ok(())
    }
}
