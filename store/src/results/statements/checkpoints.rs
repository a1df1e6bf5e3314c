use std::collections::HashMap;

use spec::Digest;
use sqlx::types::Json;
use sqlx::{FromRow, Row};

use super::rows::{deletion, digest, json, number, stored_object, tags};
use super::{Database, DbRow, Transaction, integer};
use crate::{
    Checkpoint, CheckpointFile, CheckpointId, JobId, NewCheckpoint, RunId, WhichCheckpoint,
};

macro_rules! select_checkpoint {
    ($($rest:expr),+ $(,)?) => {
        concat!(
            "SELECT checkpoint.*, job.digest, ",
            tags_of!("checkpoint_tag", "checkpoint", "checkpoint.id"),
            " AS own_tags, ",
            tags_of!("job_tag", "job", "checkpoint.job"),
            " AS job_tags, checkpoint.step = (SELECT MAX(other.step) \
             FROM checkpoint AS other WHERE other.job = checkpoint.job) AS is_last \
             FROM checkpoint JOIN job ON job.id = checkpoint.job ",
            $($rest),+
        )
    };
}

impl Database {
    pub async fn checkpoint(&self, id: CheckpointId) -> Result<Option<Checkpoint>, sqlx::Error> {
        let found = sqlx::query_as(select_checkpoint!("WHERE checkpoint.id = $1"))
            .bind(id)
            .fetch_all(&self.reader)
            .await?;
        Ok(self.with_files(found).await?.into_iter().next())
    }

    pub async fn checkpoints_by_id(
        &self,
        ids: &[CheckpointId],
    ) -> Result<Vec<Checkpoint>, sqlx::Error> {
        let found =
            sqlx::query_as(select_checkpoint!("WHERE checkpoint.id IN ", listed_ids!("$1")))
                .bind(Json(ids))
                .fetch_all(&self.reader)
                .await?;
        self.with_files(found).await
    }

    /// Sorted by step.
    pub async fn checkpoints_of_job(&self, job: JobId) -> Result<Vec<Checkpoint>, sqlx::Error> {
        let found = sqlx::query_as(select_checkpoint!(
            "WHERE checkpoint.job = $1 AND checkpoint.deleted_at IS NULL ORDER BY checkpoint.step"
        ))
        .bind(job)
        .fetch_all(&self.reader)
        .await?;
        self.with_files(found).await
    }

    /// Sorted by job, then by step.
    pub async fn checkpoint_ids(
        &self,
        jobs: &[JobId],
    ) -> Result<Vec<(JobId, CheckpointId)>, sqlx::Error> {
        sqlx::query_as(concat!(
            "SELECT job, id FROM checkpoint WHERE deleted_at IS NULL AND job IN ",
            listed_ids!("$1"),
            " \
             ORDER BY job, step"
        ))
        .bind(Json(jobs))
        .fetch_all(&self.reader)
        .await
    }

    pub async fn latest_checkpoint(&self, job: JobId) -> Result<Option<Checkpoint>, sqlx::Error> {
        let found = sqlx::query_as(select_checkpoint!(
            "WHERE checkpoint.job = $1 ORDER BY checkpoint.step DESC LIMIT 1"
        ))
        .bind(job)
        .fetch_all(&self.reader)
        .await?;
        Ok(self.with_files(found).await?.into_iter().next())
    }

    pub async fn checkpoint_by_digest(
        &self,
        digest: Digest,
        which: WhichCheckpoint,
    ) -> Result<Option<Checkpoint>, sqlx::Error> {
        let query = match which {
            WhichCheckpoint::Final => sqlx::query_as(select_checkpoint!(
                "WHERE job.digest = $1 AND checkpoint.is_final AND checkpoint.deleted_at IS NULL \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
            WhichCheckpoint::Best => sqlx::query_as(select_checkpoint!(
                "WHERE job.digest = $1 AND checkpoint.is_best AND job.state = 'succeeded' \
                 AND checkpoint.deleted_at IS NULL \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
            WhichCheckpoint::Step(_) => sqlx::query_as(select_checkpoint!(
                "WHERE job.digest = $1 AND checkpoint.step = $2 AND checkpoint.deleted_at IS NULL \
                 ORDER BY checkpoint.id DESC LIMIT 1"
            )),
        };
        let query = query.bind(digest.to_string());
        let query = match which {
            WhichCheckpoint::Step(step) => query.bind(integer(step)),
            WhichCheckpoint::Final | WhichCheckpoint::Best => query,
        };
        let found = query.fetch_all(&self.reader).await?;
        Ok(self.with_files(found).await?.into_iter().next())
    }

    async fn with_files(
        &self,
        mut checkpoints: Vec<Checkpoint>,
    ) -> Result<Vec<Checkpoint>, sqlx::Error> {
        let ids: Vec<CheckpointId> = checkpoints.iter().map(|checkpoint| checkpoint.id).collect();
        let rows = sqlx::query(concat!(
            "SELECT * FROM checkpoint_file \
             WHERE checkpoint IN ",
            listed_ids!("$1"),
            " ORDER BY checkpoint, name"
        ))
        .bind(Json(&ids))
        .fetch_all(&self.reader)
        .await?;
        let mut files: HashMap<CheckpointId, Vec<CheckpointFile>> = HashMap::new();
        for row in &rows {
            let file = CheckpointFile::from_row(row)?;
            files.entry(row.try_get("checkpoint")?).or_default().push(file);
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
    ) -> Result<CheckpointId, sqlx::Error> {
        if new.is_best {
            sqlx::query("UPDATE checkpoint SET is_best = FALSE WHERE job = $1 AND is_best")
                .bind(job)
                .execute(self.connection())
                .await?;
        }
        sqlx::query_scalar(concat!(
            "INSERT INTO checkpoint (job, run, step, is_final, is_best, metrics, created_at) ",
            "VALUES ($1, $2, $3, $4, $5, $6, ",
            now!(),
            ") ON CONFLICT (job, step) DO UPDATE SET created_at = excluded.created_at, ",
            "metrics = excluded.metrics, is_final = checkpoint.is_final OR excluded.is_final, ",
            "is_best = checkpoint.is_best OR excluded.is_best RETURNING id"
        ))
        .bind(job)
        .bind(run)
        .bind(integer(new.step))
        .bind(new.is_final)
        .bind(new.is_best)
        .bind(serde_json::json!(new.metrics).to_string())
        .fetch_one(self.connection())
        .await
    }

    pub async fn insert_checkpoint_file(
        &mut self,
        checkpoint: CheckpointId,
        file: &CheckpointFile,
    ) -> Result<(), sqlx::Error> {
        let statement = sqlx::query(
            "INSERT INTO checkpoint_file (checkpoint, name, path, size, sha256) VALUES ($1, $2, $3, $4, $5)",
        )
        .bind(checkpoint)
        .bind(&file.name)
        .bind(&file.object.path)
        .bind(integer(file.object.size))
        .bind(file.object.sha256.to_string());
        self.execute(statement).await
    }

    pub async fn last_step(&mut self, job: JobId) -> Result<Option<u64>, sqlx::Error> {
        let step: Option<i64> =
            sqlx::query_scalar("SELECT MAX(step) FROM checkpoint WHERE job = $1")
                .bind(job)
                .fetch_one(self.connection())
                .await?;
        Ok(step.map(i64::unsigned_abs))
    }

    /// Returns the paths of the objects that the rows named.
    pub async fn delete_checkpoint_files(
        &mut self,
        checkpoint: CheckpointId,
    ) -> Result<Vec<String>, sqlx::Error> {
        sqlx::query_scalar("DELETE FROM checkpoint_file WHERE checkpoint = $1 RETURNING path")
            .bind(checkpoint)
            .fetch_all(self.connection())
            .await
    }

    /// All checkpoints but the final one, the best one and the `keep` latest of the others.
    pub async fn outdated_checkpoints(
        &mut self,
        job: JobId,
        keep: u32,
    ) -> Result<Vec<CheckpointId>, sqlx::Error> {
        sqlx::query_scalar(
            "SELECT id FROM checkpoint WHERE job = $1 AND NOT is_final AND NOT is_best \
             ORDER BY step DESC LIMIT 9223372036854775807 OFFSET $2",
        )
        .bind(job)
        .bind(i64::from(keep))
        .fetch_all(self.connection())
        .await
    }

    pub async fn delete_checkpoint(&mut self, id: CheckpointId) -> Result<(), sqlx::Error> {
        let statement = sqlx::query("DELETE FROM checkpoint WHERE id = $1").bind(id);
        self.execute(statement).await
    }
}

impl FromRow<'_, DbRow> for Checkpoint {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            run: row.try_get("run")?,
            name: row.try_get("given_name")?,
            note: row.try_get("note")?,
            tags: tags(row, "own_tags")?,
            job_tags: tags(row, "job_tags")?,
            step: number(row, "step")?,
            is_final: row.try_get("is_final")?,
            is_best: row.try_get("is_best")?,
            is_last: row.try_get("is_last")?,
            metrics: json(row, "metrics")?,
            digest: digest(row, "digest")?,
            files: Vec::new(),
            created_at: row.try_get("created_at")?,
            deletion: deletion(row)?,
        })
    }
}

impl FromRow<'_, DbRow> for CheckpointFile {
    fn from_row(row: &DbRow) -> Result<Self, sqlx::Error> {
        Ok(Self { name: row.try_get("name")?, object: stored_object(row)? })
    }
}
