//! Datasets and their files.

use serde::Serialize;
use serde_json::Value;
use spec::{Digest, SimulateSpec};
use store::{DatasetId, Shard};
use utoipa::ToSchema;

use crate::app::files::Download;
use crate::app::{App, Paging, Verification};
use crate::error::ApiError;

pub use store::{DatasetState, FileContent};

const PARQUET: &str = "application/vnd.apache.parquet";

/// Trajectories of simulated robots, as Parquet files.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Dataset {
    pub id: i64,
    /// The simulation that fills it.
    pub job: i64,
    pub name: String,
    /// Of the simulation's spec.
    pub digest: Digest,
    #[schema(value_type = String, example = "complete")]
    pub state: DatasetState,
    #[schema(value_type = SimulateSpec)]
    pub spec: Value,
    /// When complete.
    pub trajectories: u64,
    /// Of each trajectory.
    pub samples: u32,
    /// Draws refused so far.
    pub rejected: u64,
    /// Of all files so far.
    pub bytes: u64,
    /// Those that exist so far; in a list of datasets, none.
    pub files: Vec<DatasetFile>,
    /// The newest one; in a list of datasets, left out.
    pub verification: Option<Verification>,
    pub created_at: String,
    pub completed_at: Option<String>,
}

/// One of the two files of a shard.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct DatasetFile {
    pub name: String,
    /// `trajectories` has a row per time step, `robots` one per trajectory.
    #[schema(value_type = String, example = "trajectories")]
    pub content: FileContent,
    pub shard: u32,
    pub rows: u64,
    /// In bytes.
    pub size: u64,
    pub sha256: Digest,
    /// Path of the download.
    pub url: String,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Datasets {
    pub datasets: Vec<Dataset>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}

impl App {
    pub async fn dataset(&self, id: i64) -> Result<Dataset, ApiError> {
        let row = self.store.dataset(DatasetId(id)).await?;
        let shards = self.store.shards(row.id).await?;
        let samples = row.samples;
        let mut dataset = Dataset::from(row);
        dataset.files = shards.iter().flat_map(|shard| files(shard, samples)).collect();
        dataset.verification = self.verification(id).await?;
        Ok(dataset)
    }

    pub async fn dataset_without_files(&self, id: i64) -> Result<Dataset, ApiError> {
        Ok(Dataset::from(self.store.dataset(DatasetId(id)).await?))
    }

    pub async fn datasets(&self, paging: Paging) -> Result<Datasets, ApiError> {
        let rows = self.store.datasets(None, paging.into()).await?;
        let next = paging.next(rows.len(), rows.last().map(|row| row.id.0));
        Ok(Datasets { datasets: rows.into_iter().map(Dataset::from).collect(), next })
    }

    pub async fn dataset_file(&self, id: i64, name: &str) -> Result<Download, ApiError> {
        let dataset = self.store.dataset(DatasetId(id)).await?;
        let shards = self.store.shards(dataset.id).await?;
        let file = shards.iter().find_map(|shard| {
            let content = FileContent::ALL.into_iter().find(|it| shard.file_name(*it) == name)?;
            Some(shard.file(content))
        });
        let file =
            file.ok_or_else(|| ApiError::not_found("file", format!("{name:?} in dataset {id}")))?;
        Ok(Download::new(format!("dataset-{id}-{name}"), PARQUET, file))
    }
}

fn files(shard: &Shard, samples: u32) -> [DatasetFile; 2] {
    FileContent::ALL.map(|content| {
        let object = shard.file(content);
        let name = shard.file_name(content);
        DatasetFile {
            url: format!("/v1/datasets/{}/files/{name}", shard.dataset),
            name,
            content,
            shard: shard.ordinal,
            rows: match content {
                FileContent::Trajectories => shard.count * u64::from(samples),
                FileContent::Robots => shard.count,
            },
            size: object.size,
            sha256: object.sha256,
        }
    })
}

impl From<store::Dataset> for Dataset {
    fn from(row: store::Dataset) -> Self {
        Self {
            id: row.id.0,
            job: row.job.0,
            name: row.name,
            digest: row.digest,
            state: row.state,
            spec: row.spec,
            trajectories: row.trajectories,
            samples: row.samples,
            rejected: row.rejected,
            bytes: row.bytes,
            files: Vec::new(),
            verification: None,
            created_at: row.created_at.to_string(),
            completed_at: row.completed_at.map(|time| time.to_string()),
        }
    }
}
