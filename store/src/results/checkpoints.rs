//! Checkpoints of trainings. A training resumes from one, and a model predicts with one.

use std::collections::BTreeMap;

use serde_json::json;
use spec::Digest;

use crate::boxed;
use crate::database::patience::patiently;
use crate::database::{Scope, sql};
use crate::events::tell;
use crate::queue::leases;
use crate::trash::refuse_deleted;
use crate::{
    CheckpointId, Deletion, EventKind, Fence, JobId, Page, RunId, Store, StoreError, StoredObject,
    Timestamp,
};

#[derive(Clone, Debug)]
pub struct Checkpoint {
    pub id: CheckpointId,
    pub job: JobId,
    pub run: RunId,
    /// The name that users gave it.
    pub name: Option<String>,
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Tags of the job, sorted.
    pub job_tags: Vec<String>,
    /// Optimizer steps taken.
    pub step: u64,
    /// Whether the training ended with it.
    pub is_final: bool,
    /// Whether it has the best validation metric so far.
    pub is_best: bool,
    /// Whether it is the training's latest.
    pub is_last: bool,
    /// Metrics of the newest validation at the time it was written.
    pub metrics: BTreeMap<String, f64>,
    /// The job's digest.
    pub digest: Digest,
    /// Sorted by name.
    pub files: Vec<CheckpointFile>,
    pub created_at: Timestamp,
    pub deletion: Option<Deletion>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointFile {
    /// E.g. `model.safetensors`.
    pub name: String,
    pub object: StoredObject,
}

impl Checkpoint {
    pub fn file(&self, name: &str) -> Option<&StoredObject> {
        self.files.iter().find(|file| file.name == name).map(|file| &file.object)
    }
}

#[derive(Clone, Debug)]
pub struct NewCheckpoint {
    pub step: u64,
    pub is_final: bool,
    /// Makes this the best checkpoint in place of the one before. A later commit of the same step
    /// does not undo that.
    pub is_best: bool,
    pub metrics: BTreeMap<String, f64>,
    /// Files that are published already.
    pub files: Vec<CheckpointFile>,
}

/// Selects one of the checkpoints of the trainings with a digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhichCheckpoint {
    Final,
    /// The best one of a training that succeeded.
    Best,
    /// The one after this number of optimizer steps.
    Step(u64),
}

impl Store {
    /// Commits a checkpoint of the fence's job. It replaces a checkpoint of the same step and keeps
    /// its id. A checkpoint of a later step than all others shows progress: earlier attempts then
    /// no longer count towards the limit.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is visible then.
    #[boxed]
    pub async fn commit_checkpoint(
        &self,
        fence: Fence,
        new: &NewCheckpoint,
    ) -> Result<CheckpointId, StoreError> {
        patiently!({
            for file in &new.files {
                self.objects().verify_published(&file.object).await?;
            }
            let mut tx = self.begin(Scope::Rows, "committing a checkpoint").await?;
            let (_, standing) = leases::held(&mut tx, fence).await?;
            let (job, run) = leases::held_run(&mut tx, fence).await?;
            if sql!(&mut tx, last_step(job))?.is_none_or(|last| last < new.step) {
                sql!(&mut tx, set_attempt(fence.task, standing.with_saved_progress().attempt))?;
            }
            let id = sql!(&mut tx, upsert_checkpoint(job, run, new))?;
            let mut replaced = sql!(&mut tx, delete_checkpoint_files(id))?;
            for file in &new.files {
                replaced.retain(|path| *path != file.object.path);
                sql!(&mut tx, insert_checkpoint_file(id, file))?;
            }
            let data = json!({
                "run": run, "checkpoint": id, "step": new.step, "is_final": new.is_final,
                "is_best": new.is_best,
            });
            tell(&mut tx, EventKind::Checkpoint, job, &data).await?;
            tx.commit().await?;
            self.objects().delete(replaced).await;
            Ok(id)
        })
    }

    /// Deletes checkpoints of the fence's job, except the final one, the best one and the `keep`
    /// latest of the others. Deletes first the rows, then the objects. Objects that remain after a
    /// crash are orphans.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    #[boxed]
    pub async fn prune_checkpoints(&self, fence: Fence, keep: u32) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Rows, "pruning checkpoints").await?;
            let (job, _) = leases::held(&mut tx, fence).await?;
            let mut paths = Vec::new();
            for id in sql!(&mut tx, outdated_checkpoints(job, keep))? {
                paths.extend(sql!(&mut tx, delete_checkpoint_files(id))?);
                sql!(&mut tx, delete_checkpoint(id))?;
            }
            tx.commit().await?;
            self.objects().delete(paths).await;
            Ok(())
        })
    }

    /// Deletes a checkpoint of the fence's job whose bytes nobody can use.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    #[boxed]
    pub async fn discard_checkpoint(
        &self,
        fence: Fence,
        id: CheckpointId,
    ) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Rows, "discarding a checkpoint").await?;
            leases::held(&mut tx, fence).await?;
            let paths = sql!(&mut tx, delete_checkpoint_files(id))?;
            sql!(&mut tx, delete_checkpoint(id))?;
            tx.commit().await?;
            self.objects().delete(paths).await;
            Ok(())
        })
    }

    /// # Errors
    /// When there is no such checkpoint, or it was deleted.
    #[boxed]
    pub async fn checkpoint(&self, id: CheckpointId) -> Result<Checkpoint, StoreError> {
        let found = sql!(self.database(), READING, checkpoint(id))?
            .ok_or_else(|| StoreError::not_found("checkpoint", id.to_string()))?;
        refuse_deleted(id, found.deletion.as_ref())?;
        Ok(found)
    }

    /// Newest first.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn checkpoints(&self, page: Page) -> Result<Vec<Checkpoint>, StoreError> {
        Ok(self.list_checkpoints(&page.into()).await?.items)
    }

    /// By step.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn checkpoints_of_job(&self, job: JobId) -> Result<Vec<Checkpoint>, StoreError> {
        sql!(self.database(), READING, checkpoints_of_job(job))
    }

    /// Each of the trainings `jobs` beside every checkpoint that it has, by step.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn checkpoint_ids(
        &self,
        jobs: &[JobId],
    ) -> Result<Vec<(JobId, CheckpointId)>, StoreError> {
        sql!(self.database(), READING, checkpoint_ids(jobs))
    }

    /// The checkpoint from which a training resumes.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn latest_checkpoint(&self, job: JobId) -> Result<Option<Checkpoint>, StoreError> {
        sql!(self.database(), READING, latest_checkpoint(job))
    }

    /// The newest such checkpoint of the trainings of a digest.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn checkpoint_by_digest(
        &self,
        digest: Digest,
        which: WhichCheckpoint,
    ) -> Result<Option<Checkpoint>, StoreError> {
        sql!(self.database(), READING, checkpoint_by_digest(digest, which))
    }
}

const READING: &str = "reading checkpoints";
