//! Artifacts: files that a run leaves, such as figures and reports.

use std::collections::BTreeMap;

use arrow_array::RecordBatch;
use bytes::Bytes;
use spec::Digest;

use crate::database::column::json;
use crate::database::patience::patiently;
use crate::database::query::{from_row, sql};
use crate::database::{Reading, Scope, Transaction};
use crate::queue::fences;
use crate::{Fence, RunId, Store, StoreError, StoredObject, Timestamp, boxed, object_path};

const COMMIT: &str = "committing an artifact";

/// A file that a run has left.
#[derive(Clone, Debug)]
pub struct Artifact {
    /// The run that left it.
    pub run: RunId,
    /// Its name, which no other artifact of the run has.
    pub name: String,
    /// E.g. `image/svg+xml`.
    pub media_type: String,
    /// Its bytes.
    pub object: StoredObject,
    /// When it was stored.
    pub created_at: Timestamp,
}

/// A file to keep with a run.
#[derive(Clone, Debug)]
pub struct NewArtifact<'a> {
    /// E.g. `rmse-multisine.svg`. An artifact of the run with the same name is replaced.
    pub name: &'a str,
    /// The media type that downloads get.
    pub media_type: &'a str,
    /// Its bytes.
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
            let (_, run) = fences::held_run(&mut tx, fence).await?;
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
            fences::held(&mut tx, fence).await?;
            let replaced = tx.upsert_artifact(run, name, media_type, object).await?;
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
        sql("SELECT * FROM artifact WHERE run IN {ids $1} ORDER BY run, name")
            .bind(json(&runs))
            .all(&mut self.read("reading the artifacts of runs"))
            .await
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
        sql("SELECT * FROM artifact WHERE run IN {ids $1} AND name = $2 ORDER BY run")
            .bind(json(&runs))
            .bind(name)
            .all(&mut self.read("reading the artifacts of runs"))
            .await
    }

    /// # Errors
    /// When the run has no artifact of this name.
    #[boxed]
    pub async fn artifact(&self, run: RunId, name: &str) -> Result<Artifact, StoreError> {
        self.read("reading an artifact")
            .artifact(run, name)
            .await?
            .ok_or_else(|| StoreError::not_found("artifact", format!("{name} of run {run}")))
    }
}

impl Reading<'_> {
    pub async fn artifact(
        &mut self,
        run: RunId,
        name: &str,
    ) -> Result<Option<Artifact>, StoreError> {
        sql("SELECT * FROM artifact WHERE run = $1 AND name = $2")
            .bind(run)
            .bind(name)
            .optional(self)
            .await
    }

    /// The paths of all objects that rows name.
    pub async fn named_objects(&mut self) -> Result<Vec<String>, StoreError> {
        sql("SELECT path FROM shard_file UNION ALL SELECT path FROM checkpoint_file \
             UNION ALL SELECT path FROM artifact UNION ALL SELECT path FROM upload \
             UNION ALL SELECT path FROM tracked_artifact")
        .all(self)
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
    ) -> Result<Option<String>, StoreError> {
        let replaced = sql("SELECT path FROM artifact WHERE run = $1 AND name = $2")
            .bind(run)
            .bind(name)
            .optional(self)
            .await?;
        sql("INSERT INTO artifact (run, name, media_type, path, size, sha256, created_at) \
             VALUES ($1, $2, $3, $4, $5, $6, {now}) ON CONFLICT (run, name) DO UPDATE \
             SET media_type = excluded.media_type, path = excluded.path, size = excluded.size, \
             sha256 = excluded.sha256, created_at = excluded.created_at")
        .bind(run)
        .bind(name)
        .bind(media_type)
        .bind(&object.path)
        .bind(object.size)
        .bind(object.sha256.to_string())
        .changed(self)
        .await?;
        Ok(replaced)
    }
}

from_row!(Artifact {
    run, name, media_type, created_at,
    ..row =>
    object: StoredObject::from_row(row)?,
});
