//! Datasets and their shards. Each simulation or import fills one, which exists from its submission
//! on.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::Digest;
use sqlx::sqlite::SqliteRow;
use sqlx::types::Text;
use sqlx::{FromRow, Row, SqliteConnection};

use crate::artifacts::stored_object;
use crate::clock::now;
use crate::database::integer;
use crate::{
    DatasetId, DatasetState, Fence, JobId, Page, Store, StoreError, StoredObject, Timestamp, jobs,
    leases, task_end,
};

#[derive(Clone, Debug)]
pub struct Dataset {
    pub id: DatasetId,
    pub job: JobId,
    /// The job's.
    pub digest: Digest,
    pub name: String,
    pub spec: Value,
    pub state: DatasetState,
    /// When complete.
    pub trajectories: u64,
    /// Of each trajectory.
    pub samples: u32,
    /// So far.
    pub shards: u64,
    /// Draws refused so far.
    pub rejected: u64,
    /// Of all files so far.
    pub bytes: u64,
    pub created_at: Timestamp,
    pub completed_at: Option<Timestamp>,
}

/// The two files of a shard.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, sqlx::Type,
)]
#[serde(rename_all = "lowercase")]
#[sqlx(rename_all = "lowercase")]
pub enum FileContent {
    /// A row per time step.
    Trajectories,
    /// A row per trajectory: its robot and its excitation.
    Robots,
}

impl FileContent {
    pub const ALL: [Self; 2] = [Self::Trajectories, Self::Robots];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Trajectories => "trajectories",
            Self::Robots => "robots",
        }
    }

    /// The name under which the file of a shard is downloaded, e.g. `trajectories-00003.parquet`.
    pub fn file_name(self, shard: u32) -> String {
        format!("{self}-{shard:05}.parquet")
    }

    /// Rows of the file of a shard with so many trajectories of so many samples.
    pub fn rows(self, trajectories: u64, samples: u32) -> u64 {
        match self {
            Self::Trajectories => trajectories * u64::from(samples),
            Self::Robots => trajectories,
        }
    }
}

impl fmt::Display for FileContent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

#[derive(Clone, Debug)]
pub struct Shard {
    pub dataset: DatasetId,
    pub ordinal: u32,
    /// Index of the first trajectory.
    pub first: u64,
    /// Number of trajectories.
    pub count: u64,
    pub rejected: u64,
    pub trajectories: StoredObject,
    pub robots: StoredObject,
}

impl Shard {
    pub const fn file(&self, content: FileContent) -> &StoredObject {
        match content {
            FileContent::Trajectories => &self.trajectories,
            FileContent::Robots => &self.robots,
        }
    }

    /// The name under which a file is downloaded, e.g. `trajectories-00003.parquet`.
    pub fn file_name(&self, content: FileContent) -> String {
        content.file_name(self.ordinal)
    }
}

/// Where it stands how many trajectories a dataset has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    /// In its row since the submission.
    Submitted,
    /// In its one shard.
    OfShard,
}

#[derive(Clone, Debug)]
pub struct NewShard {
    pub first: u64,
    pub count: u64,
    pub rejected: u64,
    pub trajectories: StoredObject,
    pub robots: StoredObject,
}

macro_rules! select_dataset {
    ($rest:literal) => {
        concat!(
            "SELECT dataset.*, job.name, job.spec, \
             (SELECT COUNT(*) FROM shard WHERE shard.dataset = dataset.id) AS shards, \
             (SELECT COALESCE(SUM(rejected), 0) FROM shard WHERE shard.dataset = dataset.id) \
             AS rejected, \
             (SELECT COALESCE(SUM(size), 0) FROM shard_file WHERE shard_file.dataset = dataset.id) \
             AS bytes \
             FROM dataset JOIN job ON job.id = dataset.job ",
            $rest
        )
    };
}

impl Store {
    /// Commits the shard of the fence's task, whose ordinal it has, and completes the task; the
    /// last shard completes dataset and job in the same transaction. Harmless when repeated.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn commit_shard(
        &self,
        fence: Fence,
        shard: &NewShard,
        result: Option<&Value>,
    ) -> Result<(), StoreError> {
        self.commit(fence, shard, result, Count::Submitted).await
    }

    /// The same for the one shard of an import, which tells how many trajectories the dataset has.
    ///
    /// # Errors
    /// [`StoreError::LeaseLost`] when the lease is lost; nothing is changed then.
    pub async fn commit_import(
        &self,
        fence: Fence,
        shard: &NewShard,
        result: &Value,
    ) -> Result<(), StoreError> {
        self.commit(fence, shard, Some(result), Count::OfShard).await
    }

    async fn commit(
        &self,
        fence: Fence,
        shard: &NewShard,
        result: Option<&Value>,
        trajectories: Count,
    ) -> Result<(), StoreError> {
        const OPERATION: &str = "committing a shard";
        let failed = StoreError::database(OPERATION);
        self.objects().verify_published(&shard.trajectories).await?;
        self.objects().verify_published(&shard.robots).await?;
        let mut tx = self.database().write(OPERATION).await?;
        let job = match leases::check(&mut tx, fence).await {
            Err(StoreError::LeaseLost { .. }) if is_committed(&mut tx, fence, shard).await? => {
                return Ok(());
            }
            other => other?,
        };
        insert_shard(&mut tx, fence, job, shard).await.map_err(&failed)?;
        if trajectories == Count::OfShard {
            set_count(&mut tx, fence, job, shard.count).await.map_err(&failed)?;
        }
        task_end::complete(&mut tx, fence, result).await?;
        tx.commit().await.map_err(&failed)
    }

    /// # Errors
    /// When there is no such dataset.
    pub async fn dataset(&self, id: DatasetId) -> Result<Dataset, StoreError> {
        sqlx::query_as(select_dataset!("WHERE dataset.id = ?"))
            .bind(id)
            .fetch_optional(self.database().reader())
            .await
            .map_err(StoreError::database("reading a dataset"))?
            .ok_or_else(|| StoreError::not_found("dataset", id.to_string()))
    }

    /// Newest first; all states without a `state`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn datasets(
        &self,
        state: Option<DatasetState>,
        page: Page,
    ) -> Result<Vec<Dataset>, StoreError> {
        sqlx::query_as(select_dataset!(
            "WHERE dataset.id < ?1 AND (?2 IS NULL OR dataset.state = ?2) \
             ORDER BY dataset.id DESC LIMIT ?3"
        ))
        .bind(page.before())
        .bind(state.map(DatasetState::as_str))
        .bind(page.limit())
        .fetch_all(self.database().reader())
        .await
        .map_err(StoreError::database("reading datasets"))
    }

    /// The newest complete dataset of a digest.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn dataset_by_digest(&self, digest: Digest) -> Result<Option<Dataset>, StoreError> {
        sqlx::query_as(select_dataset!(
            "WHERE dataset.digest = ? AND dataset.state = 'complete' \
             ORDER BY dataset.id DESC LIMIT 1"
        ))
        .bind(digest.to_string())
        .fetch_optional(self.database().reader())
        .await
        .map_err(StoreError::database("looking up a dataset by digest"))
    }

    /// In order; while the dataset is building, those that are there.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn shards(&self, dataset: DatasetId) -> Result<Vec<Shard>, StoreError> {
        let failed = StoreError::database("reading a dataset's shards");
        let rows = sqlx::query(
            "SELECT shard.*, file.content, file.path, file.size, file.sha256 FROM shard \
             JOIN shard_file AS file ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
             WHERE shard.dataset = ? ORDER BY shard.ordinal, file.content",
        )
        .bind(dataset)
        .fetch_all(self.database().reader())
        .await
        .map_err(&failed)?;
        shards_from_rows(&rows).map_err(&failed)
    }
}

/// Whether this very commit went through before, its answer lost on the way.
async fn is_committed(
    conn: &mut SqliteConnection,
    fence: Fence,
    shard: &NewShard,
) -> Result<bool, StoreError> {
    sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM shard JOIN shard_file AS file \
         ON file.dataset = shard.dataset AND file.ordinal = shard.ordinal \
         WHERE shard.task = ? AND shard.epoch = ? AND file.content = 'trajectories' \
         AND file.sha256 = ?)",
    )
    .bind(fence.task)
    .bind(fence.epoch)
    .bind(shard.trajectories.sha256.to_string())
    .fetch_one(conn)
    .await
    .map_err(StoreError::database("looking up a shard"))
}

async fn insert_shard(
    conn: &mut SqliteConnection,
    fence: Fence,
    job: JobId,
    shard: &NewShard,
) -> Result<(), sqlx::Error> {
    let (dataset, ordinal): (DatasetId, u32) = sqlx::query_as(
        "INSERT INTO shard (dataset, ordinal, first, count, rejected, task, epoch) \
         SELECT dataset.id, task.ordinal, ?, ?, ?, task.id, task.epoch \
         FROM task JOIN dataset ON dataset.job = task.job WHERE task.id = ? AND task.job = ? \
         RETURNING dataset, ordinal",
    )
    .bind(integer(shard.first))
    .bind(integer(shard.count))
    .bind(integer(shard.rejected))
    .bind(fence.task)
    .bind(job)
    .fetch_one(&mut *conn)
    .await?;
    let files =
        [(FileContent::Trajectories, &shard.trajectories), (FileContent::Robots, &shard.robots)];
    for (content, object) in files {
        sqlx::query(
            "INSERT INTO shard_file (dataset, ordinal, content, path, size, sha256) \
             VALUES (?, ?, ?, ?, ?, ?)",
        )
        .bind(dataset)
        .bind(ordinal)
        .bind(content)
        .bind(&object.path)
        .bind(integer(object.size))
        .bind(object.sha256.to_string())
        .execute(&mut *conn)
        .await?;
    }
    Ok(())
}

/// Tells dataset and progress of an import what came of it.
async fn set_count(
    conn: &mut SqliteConnection,
    fence: Fence,
    job: JobId,
    trajectories: u64,
) -> Result<(), sqlx::Error> {
    sqlx::query("UPDATE dataset SET trajectories = ? WHERE job = ?")
        .bind(integer(trajectories))
        .bind(job)
        .execute(&mut *conn)
        .await?;
    sqlx::query("UPDATE task SET total = ? WHERE id = ?")
        .bind(integer(trajectories))
        .bind(fence.task)
        .execute(&mut *conn)
        .await?;
    Ok(())
}

/// Completes the dataset of a simulation or import that succeeded, if all its trajectories are there; other
/// jobs have none.
pub(crate) async fn complete(conn: &mut SqliteConnection, job: JobId) -> Result<(), sqlx::Error> {
    sqlx::query(concat!(
        "UPDATE dataset SET state = 'complete', completed_at = ",
        now!(),
        " WHERE job = ? AND trajectories = \
          (SELECT SUM(shard.count) FROM shard WHERE shard.dataset = dataset.id)"
    ))
    .bind(job)
    .execute(conn)
    .await?;
    Ok(())
}

fn shards_from_rows(rows: &[SqliteRow]) -> Result<Vec<Shard>, sqlx::Error> {
    let mut shards = Vec::with_capacity(rows.len() / 2);
    for files in rows.chunk_by(same_shard) {
        let mut objects = files
            .iter()
            .map(|row| Ok((row.try_get("content")?, stored_object(row)?)))
            .collect::<Result<BTreeMap<FileContent, StoredObject>, sqlx::Error>>()?;
        let mut take = |content| objects.remove(&content).ok_or(sqlx::Error::RowNotFound);
        let row = &files[0];
        shards.push(Shard {
            dataset: row.try_get("dataset")?,
            ordinal: row.try_get("ordinal")?,
            first: row.try_get("first")?,
            count: row.try_get("count")?,
            rejected: row.try_get("rejected")?,
            trajectories: take(FileContent::Trajectories)?,
            robots: take(FileContent::Robots)?,
        });
    }
    Ok(shards)
}

fn same_shard(a: &SqliteRow, b: &SqliteRow) -> bool {
    let ordinal = |row: &SqliteRow| row.try_get::<i64, _>("ordinal").ok();
    ordinal(a) == ordinal(b)
}

impl FromRow<'_, SqliteRow> for Dataset {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            job: row.try_get("job")?,
            digest: jobs::digest(row, "digest")?,
            name: row.try_get("name")?,
            spec: jobs::json(row, "spec")?,
            state: row.try_get::<Text<_>, _>("state")?.0,
            trajectories: row.try_get("trajectories")?,
            samples: row.try_get("samples")?,
            shards: row.try_get("shards")?,
            rejected: row.try_get("rejected")?,
            bytes: row.try_get("bytes")?,
            created_at: row.try_get("created_at")?,
            completed_at: row.try_get("completed_at")?,
        })
    }
}
