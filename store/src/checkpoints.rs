//! Checkpoints of trainings: enough to resume from, or to predict with.

use std::collections::BTreeMap;

use spec::Digest;
use sqlx::sqlite::SqliteRow;
use sqlx::{FromRow, Row, SqliteConnection};

use crate::artifacts::stored_object;
use crate::clock::now;
use crate::database::integer;
use crate::{
    CheckpointId, Fence, JobId, Page, RunId, Store, StoreError, StoredObject, Timestamp, jobs,
    leases,
};

#[derive(Clone, Debug)]
pub struct Checkpoint {
    pub id: CheckpointId,
    pub job: JobId,
    pub run: RunId,
    /// Optimizer steps taken.
    pub step: u64,
    /// Whether training ended with it.
    pub is_final: bool,
    /// Whether its validation is the best so far.
    pub is_best: bool,
    /// Whether there is none after it.
    pub is_last: bool,
    /// Of the newest validation when it was written.
    pub metrics: BTreeMap<String, f64>,
    /// The job's.
    pub digest: Digest,
    /// By name.
    pub files: Vec<CheckpointFile>,
    pub created_at: Timestamp,
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
    /// Takes this from the one that was best before; never taken back by a later commit of the step.
    pub is_best: bool,
    pub metrics: BTreeMap<String, f64>,
    /// Published before.
    pub files: Vec<CheckpointFile>,
}

/// One of the checkpoints of the trainings of a digest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhichCheckpoint {
    Final,
    /// Of a training that succeeded.
    Best,
    /// After so many steps.
    Step(u64),
}

macro_rules! select_checkpoint {
    ($rest:literal) => {
        concat!(
            "SELECT checkpoint.*, job.digest, checkpoint.step = (SELECT MAX(other.step) \
             FROM checkpoint AS other WHERE other.job = checkpoint.job) AS is_last \
             FROM checkpoint JOIN job ON job.id = checkpoint.job ",
            $rest
        )
    };
}

impl Store {
    /// Commits a checkpoint of the fence's job; one of the same step is replaced and keeps its id.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is visible then.
    pub async fn commit_checkpoint(
        &self,
        fence: Fence,
        new: &NewCheckpoint,
    ) -> Result<CheckpointId, StoreError> {
        const OPERATION: &str = "committing a checkpoint";
        let failed = StoreError::database(OPERATION);
        for file in &new.files {
            self.objects().verify_published(&file.object).await?;
        }
        let mut tx = self.database().write(OPERATION).await?;
        let job = leases::check(&mut tx, fence).await?;
        let run = leases::check_run(&mut tx, fence).await?;
        if new.is_best {
            sqlx::query("UPDATE checkpoint SET is_best = 0 WHERE job = ? AND is_best = 1")
                .bind(job)
                .execute(&mut *tx)
                .await
                .map_err(&failed)?;
        }
        let id: CheckpointId = sqlx::query_scalar(concat!(
            "INSERT INTO checkpoint (job, run, step, is_final, is_best, metrics, created_at) ",
            "VALUES (?, ?, ?, ?, ?, ?, ",
            now!(),
            ") ON CONFLICT (job, step) DO UPDATE SET created_at = excluded.created_at, ",
            "metrics = excluded.metrics, is_final = MAX(checkpoint.is_final, excluded.is_final), ",
            "is_best = MAX(checkpoint.is_best, excluded.is_best) RETURNING id"
        ))
        .bind(job)
        .bind(run)
        .bind(integer(new.step))
        .bind(new.is_final)
        .bind(new.is_best)
        .bind(sqlx::types::Json(&new.metrics))
        .fetch_one(&mut *tx)
        .await
        .map_err(&failed)?;
        let mut replaced = delete_files(&mut tx, id).await.map_err(&failed)?;
        for file in &new.files {
            replaced.retain(|path| *path != file.object.path);
            insert_file(&mut tx, id, file).await.map_err(&failed)?;
        }
        tx.commit().await.map_err(&failed)?;
        self.objects().delete(replaced).await;
        Ok(id)
    }

    /// Deletes all but the final, the best and, of the others, the `keep` latest checkpoints of the
    /// fence's job: first the rows, then the objects. What a crash leaves of these is an orphan.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn prune_checkpoints(&self, fence: Fence, keep: u32) -> Result<(), StoreError> {
        const OPERATION: &str = "pruning checkpoints";
        let failed = StoreError::database(OPERATION);
        let mut tx = self.database().write(OPERATION).await?;
        let job = leases::check(&mut tx, fence).await?;
        let pruned: Vec<CheckpointId> = sqlx::query_scalar(
            "SELECT id FROM checkpoint WHERE job = ? AND is_final = 0 AND is_best = 0 \
             ORDER BY step DESC LIMIT -1 OFFSET ?",
        )
        .bind(job)
        .bind(keep)
        .fetch_all(&mut *tx)
        .await
        .map_err(&failed)?;
        let mut paths = Vec::new();
        for id in pruned {
            paths.extend(delete_files(&mut tx, id).await.map_err(&failed)?);
            sqlx::query("DELETE FROM checkpoint WHERE id = ?")
                .bind(id)
                .execute(&mut *tx)
                .await
                .map_err(&failed)?;
        }
        tx.commit().await.map_err(&failed)?;
        self.objects().delete(paths).await;
        Ok(())
    }

    /// # Errors
    /// When there is no such checkpoint.
    pub async fn checkpoint(&self, id: CheckpointId) -> Result<Checkpoint, StoreError> {
        let found = sqlx::query_as(select_checkpoint!("WHERE checkpoint.id = ?"))
            .bind(id)
            .fetch_all(self.database().reader())
            .await;
        let found = self.with_files(found).await?;
        found.into_iter().next().ok_or_else(|| StoreError::not_found("checkpoint", id.to_string()))
    }

    /// Newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn checkpoints(&self, page: Page) -> Result<Vec<Checkpoint>, StoreError> {
        let found = sqlx::query_as(select_checkpoint!(
            "WHERE checkpoint.id < ? ORDER BY checkpoint.id DESC LIMIT ?"
        ))
        .bind(page.before())
        .bind(page.limit())
        .fetch_all(self.database().reader())
        .await;
        self.with_files(found).await
    }

    /// By step.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn checkpoints_of_job(&self, job: JobId) -> Result<Vec<Checkpoint>, StoreError> {
        let found =
            sqlx::query_as(select_checkpoint!("WHERE checkpoint.job = ? ORDER BY checkpoint.step"))
                .bind(job)
                .fetch_all(self.database().reader())
                .await;
        self.with_files(found).await
    }

    /// What a training resumes from.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn latest_checkpoint(&self, job: JobId) -> Result<Option<Checkpoint>, StoreError> {
        let found = sqlx::query_as(select_checkpoint!(
            "WHERE checkpoint.job = ? ORDER BY checkpoint.step DESC LIMIT 1"
        ))
        .bind(job)
        .fetch_all(self.database().reader())
        .await;
        Ok(self.with_files(found).await?.into_iter().next())
    }

    /// The newest such checkpoint of the trainings of a digest.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn checkpoint_by_digest(
        &self,
        digest: Digest,
        which: WhichCheckpoint,
    ) -> Result<Option<Checkpoint>, StoreError> {
        let query = match which {
            WhichCheckpoint::Final => sqlx::query_as(select_checkpoint!(
                "WHERE job.digest = ? AND checkpoint.is_final = 1 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
            WhichCheckpoint::Best => sqlx::query_as(select_checkpoint!(
                "WHERE job.digest = ? AND checkpoint.is_best = 1 AND job.state = 'succeeded' \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
            WhichCheckpoint::Step(_) => sqlx::query_as(select_checkpoint!(
                "WHERE job.digest = ? AND checkpoint.step = ? ORDER BY checkpoint.id DESC LIMIT 1"
            )),
        };
        let query = query.bind(digest.to_string());
        let query = match which {
            WhichCheckpoint::Step(step) => query.bind(integer(step)),
            WhichCheckpoint::Final | WhichCheckpoint::Best => query,
        };
        let found = query.fetch_all(self.database().reader()).await;
        Ok(self.with_files(found).await?.into_iter().next())
    }

    async fn with_files(
        &self,
        found: Result<Vec<Checkpoint>, sqlx::Error>,
    ) -> Result<Vec<Checkpoint>, StoreError> {
        let failed = StoreError::database("reading checkpoints");
        let mut checkpoints = found.map_err(&failed)?;
        for checkpoint in &mut checkpoints {
            checkpoint.files =
                sqlx::query_as("SELECT * FROM checkpoint_file WHERE checkpoint = ? ORDER BY name")
                    .bind(checkpoint.id)
                    .fetch_all(self.database().reader())
                    .await
                    .map_err(&failed)?;
        }
        // One that was pruned since its row was read.
        checkpoints.retain(|checkpoint| !checkpoint.files.is_empty());
        Ok(checkpoints)
    }
}

/// Returns the paths of the objects that the rows named.
async fn delete_files(
    conn: &mut SqliteConnection,
    checkpoint: CheckpointId,
) -> Result<Vec<String>, sqlx::Error> {
    sqlx::query_scalar("DELETE FROM checkpoint_file WHERE checkpoint = ? RETURNING path")
        .bind(checkpoint)
        .fetch_all(conn)
        .await
}

async fn insert_file(
    conn: &mut SqliteConnection,
    checkpoint: CheckpointId,
    file: &CheckpointFile,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "INSERT INTO checkpoint_file (checkpoint, name, path, size, sha256) VALUES (?, ?, ?, ?, ?)",
    )
    .bind(checkpoint)
    .bind(&file.name)
    .bind(&file.object.path)
    .bind(integer(file.object.size))
    .bind(file.object.sha256.to_string())
    .execute(conn)
    .await?;
    Ok(())
}

impl FromRow<'_, SqliteRow> for Checkpoint {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            run: row.try_get("run")?,
            step: row.try_get("step")?,
            is_final: row.try_get("is_final")?,
            is_best: row.try_get("is_best")?,
            is_last: row.try_get("is_last")?,
            metrics: row.try_get::<sqlx::types::Json<_>, _>("metrics")?.0,
            digest: jobs::digest(row, "digest")?,
            files: Vec::new(),
            created_at: row.try_get("created_at")?,
        })
    }
}

impl FromRow<'_, SqliteRow> for CheckpointFile {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self { name: row.try_get("name")?, object: stored_object(row)? })
    }
}
