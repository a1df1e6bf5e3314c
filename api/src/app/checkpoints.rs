//! Checkpoints and their files.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use spec::Digest;
use store::{CheckpointId, JobId};
use utoipa::ToSchema;

use crate::app::files::{Download, StoredFile};
use crate::app::{App, Paging};
use crate::error::ApiError;

/// Weights of a model after some steps of training, with everything to resume.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Checkpoint {
    pub id: i64,
    /// The training.
    pub job: i64,
    pub run: i64,
    /// Optimizer steps taken.
    pub step: u64,
    /// Whether training ended with it.
    #[serde(rename = "final")]
    pub is_final: bool,
    /// Whether its validation is the best so far, by the training's `monitor`.
    #[serde(rename = "best")]
    pub is_best: bool,
    /// Whether there is none after it.
    #[serde(rename = "last")]
    pub is_last: bool,
    /// Newest values when it was written, `validation/rmse_deg` among them once there was one.
    pub metrics: BTreeMap<String, f64>,
    /// Of the training's spec.
    pub digest: Digest,
    #[schema(example = "robomorph")]
    pub architecture: String,
    pub files: Vec<StoredFile>,
    pub created_at: String,
}

#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Checkpoints {
    pub checkpoints: Vec<Checkpoint>,
    /// The `before` of the following page.
    pub next: Option<i64>,
}

/// How many samples a model is given and how many it predicts.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Extents {
    pub context: u32,
    pub horizon: u32,
}

impl App {
    /// From its `config.json`; `None` if that does not say.
    pub async fn checkpoint_extents(&self, id: i64) -> Result<Option<Extents>, ApiError> {
        let row = self.store.checkpoint(CheckpointId(id)).await?;
        let Some(config) = row.file("config.json") else { return Ok(None) };
        let config = self.store.read_object(config).await?;
        Ok(serde_json::from_slice(&config).ok())
    }

    pub async fn checkpoint(&self, id: i64) -> Result<Checkpoint, ApiError> {
        let row = self.store.checkpoint(CheckpointId(id)).await?;
        let job = self.store.job(row.job).await?;
        Ok(checkpoint(row, &job.spec))
    }

    pub async fn checkpoints(&self, paging: Paging) -> Result<Checkpoints, ApiError> {
        let rows = self.store.checkpoints(paging.into()).await?;
        let next = paging.next(rows.len(), rows.last().map(|row| row.id.0));
        let mut checkpoints = Vec::with_capacity(rows.len());
        for row in rows {
            let job = self.store.job(row.job).await?;
            checkpoints.push(checkpoint(row, &job.spec));
        }
        Ok(Checkpoints { checkpoints, next })
    }

    /// What a training has made so far, oldest first.
    pub async fn checkpoints_of_job(&self, job: i64) -> Result<Vec<Checkpoint>, ApiError> {
        let spec = self.store.job(JobId(job)).await?.spec;
        let rows = self.store.checkpoints_of_job(JobId(job)).await?;
        Ok(rows.into_iter().map(|row| checkpoint(row, &spec)).collect())
    }

    pub async fn checkpoint_file(&self, id: i64, name: &str) -> Result<Download, ApiError> {
        let checkpoint = self.store.checkpoint(CheckpointId(id)).await?;
        let object = checkpoint
            .file(name)
            .ok_or_else(|| ApiError::not_found("file", format!("{name:?} in checkpoint {id}")))?;
        Ok(Download::new(format!("checkpoint-{id}-{name}"), media_type(name), object))
    }
}

fn media_type(name: &str) -> &'static str {
    if name.ends_with(".json") { "application/json" } else { "application/octet-stream" }
}

fn checkpoint(row: store::Checkpoint, spec: &Value) -> Checkpoint {
    let id = row.id.0;
    let architecture = spec.pointer("/model/architecture").and_then(Value::as_str);
    Checkpoint {
        id,
        job: row.job.0,
        run: row.run.0,
        step: row.step,
        is_final: row.is_final,
        is_best: row.is_best,
        is_last: row.is_last,
        metrics: row.metrics,
        digest: row.digest,
        architecture: architecture.unwrap_or_default().to_owned(),
        files: row
            .files
            .into_iter()
            .map(|file| StoredFile {
                url: format!("/v1/checkpoints/{id}/files/{}", file.name),
                name: file.name,
                size: file.object.size,
                sha256: file.object.sha256,
            })
            .collect(),
        created_at: row.created_at.to_string(),
    }
}
