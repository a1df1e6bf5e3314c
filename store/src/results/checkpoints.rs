//! Checkpoints of trainings. A training resumes from one, and a model predicts with one.

use std::collections::{BTreeMap, HashMap};

use serde_json::json;
use spec::Digest;

use crate::database::column::json;
use crate::database::patience::patiently;
use crate::database::query::{FromRow, from_row, sql};
use crate::database::rows::{deletion, tags};
use crate::database::{Reading, Scope, Transaction};
use crate::events::tell;
use crate::lists::listing::{LISTING, Listed};
use crate::queue::fences;
use crate::trash::refuse_deleted;
use crate::{
    CheckpointId, Deletion, EventKind, Fence, ItemKind, JobId, Listing, Page, RunId, Store,
    StoreError, StoredObject, Timestamp, boxed,
};

macro_rules! select_checkpoint {
    ($($rest:expr),+ $(,)?) => {
        concat!(
            "SELECT checkpoint.*, job.digest, ",
            "{tags checkpoint_tag checkpoint checkpoint.id}",
            " AS own_tags, ",
            "{tags job_tag job checkpoint.job}",
            " AS job_tags, ",
            "{aliases checkpoint.id}",
            " AS aliases, checkpoint.step = (SELECT MAX(other.step) \
             FROM checkpoint AS other WHERE other.job = checkpoint.job) AS is_last \
             FROM checkpoint JOIN job ON job.id = checkpoint.job ",
            $($rest),+
        )
    };
}

/// A checkpoint of a training, as it is now.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// Its id.
    pub id: CheckpointId,
    /// The training.
    pub job: JobId,
    /// The record of the training.
    pub run: RunId,
    /// The name that users gave it.
    pub name: Option<String>,
    /// A note in Markdown.
    pub note: Option<String>,
    /// Sorted.
    pub tags: Vec<String>,
    /// Tags of the job, sorted.
    pub job_tags: Vec<String>,
    /// Names that stand for this checkpoint alone, sorted.
    pub aliases: Vec<String>,
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
    /// When it was committed.
    pub created_at: Timestamp,
    /// When it was moved to the trash; `None` if it was not.
    pub deletion: Option<Deletion>,
}

/// A file of a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckpointFile {
    /// E.g. `model.safetensors`.
    pub name: String,
    /// Its bytes.
    pub object: StoredObject,
}

impl Checkpoint {
    /// The file with this name.
    pub fn file(&self, name: &str) -> Option<&StoredObject> {
        self.files.iter().find(|file| file.name == name).map(|file| &file.object)
    }
}

/// A checkpoint to commit. Its files are published already.
#[derive(Clone, Debug)]
pub struct NewCheckpoint {
    /// The training step after which it was made.
    pub step: u64,
    /// Whether the training ends with it.
    pub is_final: bool,
    /// Makes this the best checkpoint in place of the one before. A later commit of the same step
    /// does not undo that.
    pub is_best: bool,
    /// The validation, by the names of its measures.
    pub metrics: BTreeMap<String, f64>,
    /// Files that are published already.
    pub files: Vec<CheckpointFile>,
}

/// Selects one of the checkpoints of the trainings with a digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhichCheckpoint {
    /// The last one of an ended training.
    Final,
    /// The best one of a training that succeeded.
    Best,
    /// The one after this number of optimizer steps.
    Step(u64),
    /// The one with a file of this SHA-256.
    Weights(Digest),
}

impl Store {
    /// A page of the list of checkpoints.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn list_checkpoints(
        &self,
        listing: &Listing,
    ) -> Result<Listed<Checkpoint>, StoreError> {
        let found = self.found(ItemKind::Checkpoint, listing).await?;
        let ids: Vec<CheckpointId> = found.ids.iter().copied().map(CheckpointId).collect();
        let rows = self.read(LISTING).checkpoints_by_id(&ids).await?;
        Ok(found.with(rows, |checkpoint| checkpoint.id.0))
    }

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
            let (_, standing) = fences::held(&mut tx, fence).await?;
            let (job, run) = fences::held_run(&mut tx, fence).await?;
            if tx.last_step(job).await?.is_none_or(|last| last < new.step) {
                tx.set_attempt(fence.task, standing.with_saved_progress().attempt).await?;
            }
            let id = tx.upsert_checkpoint(job, run, new).await?;
            let mut replaced = tx.delete_checkpoint_files(id).await?;
            for file in &new.files {
                replaced.retain(|path| *path != file.object.path);
                tx.insert_checkpoint_file(id, file).await?;
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

    /// Deletes checkpoints of the fence's job, except the final one, the best one, those with an alias and the `keep`
    /// latest of the others. Deletes first the rows, then the objects. Objects that remain after a
    /// crash are orphans.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    #[boxed]
    pub async fn prune_checkpoints(&self, fence: Fence, keep: u32) -> Result<(), StoreError> {
        patiently!({
            let mut tx = self.begin(Scope::Rows, "pruning checkpoints").await?;
            let (job, _) = fences::held(&mut tx, fence).await?;
            let mut paths = Vec::new();
            for id in tx.outdated_checkpoints(job, keep).await? {
                paths.extend(tx.delete_checkpoint_files(id).await?);
                tx.delete_checkpoint(id).await?;
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
            fences::held(&mut tx, fence).await?;
            let paths = tx.delete_checkpoint_files(id).await?;
            tx.delete_checkpoint(id).await?;
            tx.commit().await?;
            self.objects().delete(paths).await;
            Ok(())
        })
    }

    /// # Errors
    /// When there is no such checkpoint, or it was deleted.
    #[boxed]
    pub async fn checkpoint(&self, id: CheckpointId) -> Result<Checkpoint, StoreError> {
        let found = self
            .read(READING)
            .checkpoint(id)
            .await?
            .ok_or_else(|| StoreError::not_found("checkpoint", id.to_string()))?;
        refuse_deleted(id, found.deletion.as_ref())?;
        Ok(found)
    }

    /// The checkpoint that an alias stands for, also one in the trash.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn checkpoint_of_alias(
        &self,
        alias: &str,
    ) -> Result<Option<CheckpointId>, StoreError> {
        sql("SELECT checkpoint FROM checkpoint_alias WHERE alias = $1")
            .bind(alias)
            .optional(&mut self.read(READING))
            .await
    }

    /// The aliases of all checkpoints, sorted, with the checkpoints.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn aliases(&self) -> Result<Vec<(String, CheckpointId)>, StoreError> {
        sql("SELECT alias, checkpoint FROM checkpoint_alias ORDER BY alias")
            .all(&mut self.read(READING))
            .await
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
        let mut reading = self.read(READING);
        let found = sql(select_checkpoint!(
            "WHERE checkpoint.job = $1 AND checkpoint.deleted_at IS NULL ORDER BY checkpoint.step"
        ))
        .bind(job)
        .all(&mut reading)
        .await?;
        reading.with_files(found).await
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
        sql("SELECT job, id FROM checkpoint WHERE deleted_at IS NULL AND job IN {ids $1} \
             ORDER BY job, step")
        .bind(json(&jobs))
        .all(&mut self.read(READING))
        .await
    }

    /// The checkpoint from which a training resumes.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn latest_checkpoint(&self, job: JobId) -> Result<Option<Checkpoint>, StoreError> {
        let mut reading = self.read(READING);
        let found = sql(select_checkpoint!(
            "WHERE checkpoint.job = $1 ORDER BY checkpoint.step DESC LIMIT 1"
        ))
        .bind(job)
        .all(&mut reading)
        .await?;
        Ok(reading.with_files(found).await?.into_iter().next())
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
        let mut reading = self.read(READING);
        let query = match which {
            WhichCheckpoint::Final => sql(select_checkpoint!(
                "WHERE job.digest = $1 AND checkpoint.is_final AND checkpoint.deleted_at IS NULL \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
            WhichCheckpoint::Best => sql(select_checkpoint!(
                "WHERE job.digest = $1 AND checkpoint.is_best AND job.state = 'succeeded' \
                 AND checkpoint.deleted_at IS NULL \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
            WhichCheckpoint::Step(_) => sql(select_checkpoint!(
                "WHERE job.digest = $1 AND checkpoint.step = $2 AND checkpoint.deleted_at IS NULL \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
            WhichCheckpoint::Weights(_) => sql(select_checkpoint!(
                "WHERE job.digest = $1 AND checkpoint.deleted_at IS NULL AND checkpoint.id IN \
                 (SELECT file.checkpoint FROM checkpoint_file AS file WHERE file.sha256 = $2) \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
        };
        let query = query.bind(digest);
        let query = match which {
            WhichCheckpoint::Step(step) => query.bind(step),
            WhichCheckpoint::Weights(sha256) => query.bind(sha256),
            WhichCheckpoint::Final | WhichCheckpoint::Best => query,
        };
        let found = query.all(&mut reading).await?;
        Ok(reading.with_files(found).await?.into_iter().next())
    }
}

const READING: &str = "reading checkpoints";

impl Reading<'_> {
    pub async fn checkpoint(&mut self, id: CheckpointId) -> Result<Option<Checkpoint>, StoreError> {
        let found = sql(select_checkpoint!("WHERE checkpoint.id = $1")).bind(id).all(self).await?;
        Ok(self.with_files(found).await?.into_iter().next())
    }

    pub async fn checkpoints_by_id(
        &mut self,
        ids: &[CheckpointId],
    ) -> Result<Vec<Checkpoint>, StoreError> {
        let found = sql(select_checkpoint!("WHERE checkpoint.id IN ", "{ids $1}"))
            .bind(json(&ids))
            .all(self)
            .await?;
        self.with_files(found).await
    }

    async fn with_files(
        &mut self,
        mut checkpoints: Vec<Checkpoint>,
    ) -> Result<Vec<Checkpoint>, StoreError> {
        let ids: Vec<CheckpointId> = checkpoints.iter().map(|checkpoint| checkpoint.id).collect();
        let rows = sql(
            "SELECT * FROM checkpoint_file WHERE checkpoint IN {ids $1} ORDER BY checkpoint, name",
        )
        .bind(json(&ids))
        .rows(self)
        .await?;
        let mut files: HashMap<CheckpointId, Vec<CheckpointFile>> = HashMap::new();
        for row in &rows {
            let file = CheckpointFile::from_row(row)?;
            files.entry(row.get("checkpoint")?).or_default().push(file);
        }
        for checkpoint in &mut checkpoints {
            checkpoint.files = files.remove(&checkpoint.id).unwrap_or_default();
        }
        // A checkpoint without files was pruned after its row was read. A purged one says so in its
        // row.
        checkpoints
            .retain(|checkpoint| !checkpoint.files.is_empty() || checkpoint.deletion.is_some());
        Ok(checkpoints)
    }
}

impl Transaction {
    /// Replaces a checkpoint of the same step and keeps its id.
    pub async fn upsert_checkpoint(
        &mut self,
        job: JobId,
        run: RunId,
        new: &NewCheckpoint,
    ) -> Result<CheckpointId, StoreError> {
        if new.is_best {
            sql("UPDATE checkpoint SET is_best = FALSE WHERE job = $1 AND is_best")
                .bind(job)
                .changed(self)
                .await?;
        }
        sql("INSERT INTO checkpoint (job, run, step, is_final, is_best, metrics, created_at) \
             VALUES ($1, $2, $3, $4, $5, $6, {now}) ON CONFLICT (job, step) DO UPDATE \
             SET created_at = excluded.created_at, metrics = excluded.metrics, is_final = \
             checkpoint.is_final OR excluded.is_final, is_best = checkpoint.is_best \
             OR excluded.is_best RETURNING id")
        .bind(job)
        .bind(run)
        .bind(new.step)
        .bind(new.is_final)
        .bind(new.is_best)
        .bind(serde_json::json!(new.metrics).to_string())
        .one(self)
        .await
    }

    pub async fn insert_checkpoint_file(
        &mut self,
        checkpoint: CheckpointId,
        file: &CheckpointFile,
    ) -> Result<(), StoreError> {
        sql(
            "INSERT INTO checkpoint_file (checkpoint, name, path, size, sha256) VALUES ($1, $2, $3, $4, $5)",
        )
        .bind(checkpoint)
        .bind(&file.name)
        .bind(&file.object.path)
        .bind(file.object.size)
        .bind(file.object.sha256.to_string()).run(self).await
    }

    pub async fn last_step(&mut self, job: JobId) -> Result<Option<u64>, StoreError> {
        let step: Option<i64> =
            sql("SELECT MAX(step) FROM checkpoint WHERE job = $1").bind(job).one(self).await?;
        Ok(step.map(i64::unsigned_abs))
    }

    /// Returns the paths of the objects that the rows named.
    pub async fn delete_checkpoint_files(
        &mut self,
        checkpoint: CheckpointId,
    ) -> Result<Vec<String>, StoreError> {
        sql("DELETE FROM checkpoint_file WHERE checkpoint = $1 RETURNING path")
            .bind(checkpoint)
            .all(self)
            .await
    }

    /// All checkpoints but the final one, the best one, those with an alias and the `keep` latest of the others.
    pub async fn outdated_checkpoints(
        &mut self,
        job: JobId,
        keep: u32,
    ) -> Result<Vec<CheckpointId>, StoreError> {
        sql("SELECT id FROM checkpoint WHERE job = $1 AND NOT is_final AND NOT is_best \
             AND id NOT IN (SELECT checkpoint FROM checkpoint_alias) \
             ORDER BY step DESC LIMIT 9223372036854775807 OFFSET $2")
        .bind(job)
        .bind(keep)
        .all(self)
        .await
    }

    pub async fn delete_checkpoint(&mut self, id: CheckpointId) -> Result<(), StoreError> {
        sql("DELETE FROM checkpoint WHERE id = $1").bind(id).run(self).await
    }
}

from_row!(Checkpoint {
    id, job, run, note, step, is_final, is_best, is_last, digest, created_at,
    ..row =>
    name: row.get("given_name")?,
    tags: tags(row, "own_tags")?,
    job_tags: tags(row, "job_tags")?,
    aliases: tags(row, "aliases")?,
    metrics: row.json("metrics")?,
    files: Vec::new(),
    deletion: deletion(row)?,
});

from_row!(CheckpointFile { name, ..row => object: StoredObject::from_row(row)? });
