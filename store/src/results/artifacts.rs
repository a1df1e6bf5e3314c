//! Artifacts: files that a run leaves, such as figures and reports.

use std::collections::BTreeMap;

use arrow_array::RecordBatch;
use bytes::Bytes;
use spec::Digest;

use crate::boxed;
use crate::database::patience::patiently;
use crate::database::{Scope, sql};
use crate::queue::leases;
use crate::{Fence, RunId, Store, StoreError, StoredObject, Timestamp, object_path};

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
    /// E.g. `rmse-multisine.svg`. An artifact of the run with the same name is replaced.
    pub name: &'a str,
    pub media_type: &'a str,
    pub bytes: Bytes,
}

impl Store {
    /// Publishes a file and commits it as an artifact of the fence's run.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. The file is not visible then.
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

    /// Publishes a Parquet table and commits it as an artifact of the fence's run. Returns that
    /// run. `footer` goes into the file's key-value metadata.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost. The file is not visible then. It also
    /// fails when the disk is full.
    #[boxed]
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
        patiently!({
            let mut tx = self.begin(Scope::Rows, COMMIT).await?;
            let (_, run) = leases::held_run(&mut tx, fence).await?;
            Ok(run)
        })
    }

    /// Commits the row that makes a published object an artifact.
    async fn commit_artifact(
        &self,
        fence: Fence,
        run: RunId,
        name: &str,
        media_type: &str,
        object: &StoredObject,
    ) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Rows, COMMIT).await?;
            leases::held(&mut tx, fence).await?;
            let replaced = sql!(&mut tx, upsert_artifact(run, name, media_type, object))?;
            tx.commit().await?;
            let outdated = replaced.into_iter().filter(|old| *old != object.path).collect();
            self.objects().delete(outdated).await;
            Ok(())
        })
    }

    /// The artifacts of all `runs`, sorted by run and name.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn artifacts(&self, runs: &[RunId]) -> Result<Vec<Artifact>, StoreError> {
        sql!(self.database(), "reading the artifacts of runs", artifacts(runs))
    }

    /// For each of `runs`, its artifact with this name, if it has one.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn artifacts_named(
        &self,
        runs: &[RunId],
        name: &str,
    ) -> Result<Vec<Artifact>, StoreError> {
        sql!(self.database(), "reading the artifacts of runs", artifacts_named(runs, name))
    }

    /// # Errors
    /// When the run has no artifact of this name.
    #[boxed]
    pub async fn artifact(&self, run: RunId, name: &str) -> Result<Artifact, StoreError> {
        sql!(self.database(), "reading an artifact", artifact(run, name))?
            .ok_or_else(|| StoreError::not_found("artifact", format!("{name} of run {run}")))
    }
}
