//! Checkpoints and their files.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;
use serde_json::Value;
use spec::Given;
use store::{CheckpointId, JobId, Listed, Listing, Store, StoreError, WhichCheckpoint};
use wire::{Checkpoint, DrawnPredictor, StoredFile};

use crate::app::App;
use crate::app::archive::{Content, Member};
use crate::app::files::Download;
use crate::app::resources::{Downloaded, Resource};
use crate::error::ApiError;

/// The shape of a question to a model.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Extents {
    /// Number of samples.
    pub context: u32,
    /// Number of samples.
    pub horizon: u32,
    #[serde(default = "seven")]
    pub joints: usize,
    #[serde(default)]
    pub given: Given,
}

/// `config.json` leaves out the number of joints of a Panda.
const fn seven() -> usize {
    7
}

impl Resource for Checkpoint {
    type Row = store::Checkpoint;

    async fn rows(store: &Store, listing: &Listing) -> Result<Listed<Self::Row>, StoreError> {
        store.list_checkpoints(listing).await
    }

    fn spec(_: &Self::Row) -> Option<&Value> {
        None
    }

    async fn complete(app: &App, rows: Vec<Self::Row>) -> Result<Vec<Self>, ApiError> {
        let trainings: BTreeSet<JobId> = rows.iter().map(|row| row.job).collect();
        let trainings: Vec<JobId> = trainings.into_iter().collect();
        let specs: BTreeMap<JobId, Value> =
            app.store.specs(&trainings).await?.into_iter().collect();
        let names = app.data_names(specs.values()).await?;
        let checkpoint = |row: store::Checkpoint| {
            let spec = specs.get(&row.job).unwrap_or(&Value::Null);
            checkpoint(row, spec, names.of(spec))
        };
        Ok(rows.into_iter().map(checkpoint).collect())
    }

    async fn find(app: &App, id: i64) -> Result<Self, ApiError> {
        app.checkpoint(id).await
    }
}

impl Downloaded for Checkpoint {
    async fn file(app: &App, id: i64, name: &str) -> Result<Download, ApiError> {
        let checkpoint = app.store.checkpoint(CheckpointId(id)).await?;
        let object = checkpoint
            .file(name)
            .ok_or_else(|| ApiError::not_found("file", format!("{name:?} in checkpoint {id}")))?;
        let file = format!("{name} of checkpoint {id}");
        Ok(Download::new(format!("checkpoint-{id}-{name}"), media_type(name), object, file))
    }

    async fn tar(app: &App, id: i64) -> Result<Download, ApiError> {
        let checkpoint = app.store.checkpoint(CheckpointId(id)).await?;
        let member = |file: store::CheckpointFile| {
            let what = format!("{} of checkpoint {id}", file.name);
            Member { name: file.name, content: Content::Stored { object: file.object, file: what } }
        };
        let files = checkpoint.files.into_iter().map(member).collect();
        Download::tar(&format!("checkpoint-{id}"), files)
    }
}

impl App {
    /// The extents in `config.json`; `None` if it has none.
    pub(crate) async fn checkpoint_extents(&self, id: i64) -> Result<Option<Extents>, ApiError> {
        let row = self.store.checkpoint(CheckpointId(id)).await?;
        let Some(config) = row.file("config.json") else { return Ok(None) };
        let file = || format!("config.json of checkpoint {id}");
        let config = self.store.read_object(config).await;
        let config = config.map_err(|error| ApiError::reading(file(), error))?;
        Ok(serde_json::from_slice(&config).ok())
    }

    pub(crate) async fn checkpoint(&self, id: i64) -> Result<Checkpoint, ApiError> {
        let row = self.store.checkpoint(CheckpointId(id)).await?;
        Checkpoint::complete(self, vec![row]).await?.pop().ok_or(ApiError::Internal)
    }

    /// The checkpoint that an alias stands for.
    ///
    /// # Errors
    /// [`ApiError::NotFound`] when no checkpoint has it.
    pub(crate) async fn checkpoint_of_alias(&self, alias: &str) -> Result<i64, ApiError> {
        match self.store.checkpoint_of_alias(alias).await? {
            Some(checkpoint) => Ok(checkpoint.0),
            None => Err(ApiError::not_found("checkpoint", format!("with the alias {alias:?}"))),
        }
    }

    /// The checkpoint that an evaluation drew, if it is one and is there.
    pub(crate) async fn drawn_checkpoint(
        &self,
        predictor: &DrawnPredictor,
    ) -> Result<Option<i64>, ApiError> {
        let (Some(digest), Some(step)) = (predictor.digest, predictor.step) else {
            return Ok(None);
        };
        let which = match predictor.weights {
            Some(weights) => WhichCheckpoint::Weights(weights),
            None => WhichCheckpoint::Step(step),
        };
        let found = self.store.checkpoint_by_digest(digest, which).await?;
        Ok(found.map(|checkpoint| checkpoint.id.0))
    }

    /// The dataset that a checkpoint was trained on, if it was one and is still there.
    pub(crate) async fn dataset_of_training(
        &self,
        checkpoint: &Checkpoint,
    ) -> Result<Option<i64>, ApiError> {
        let training = self.job(checkpoint.job).await?;
        let needed = self.jobs_by_id(&training.needs).await?;
        Ok(needed.into_values().find_map(|job| job.dataset))
    }

    /// The checkpoints that a training has made so far, oldest first.
    pub(crate) async fn checkpoints_of_job(&self, job: i64) -> Result<Vec<Checkpoint>, ApiError> {
        let rows = self.store.checkpoints_of_job(JobId(job)).await?;
        Checkpoint::complete(self, rows).await
    }
}

fn media_type(name: &str) -> &'static str {
    if name.ends_with(".json") { "application/json" } else { "application/octet-stream" }
}

fn checkpoint(row: store::Checkpoint, spec: &Value, data: Option<String>) -> Checkpoint {
    let id = row.id.0;
    let architecture = spec.pointer("/model/architecture").and_then(Value::as_str);
    Checkpoint {
        id,
        job: row.job.0,
        run: row.run.0,
        name: row.name,
        note: row.note,
        tags: row.tags,
        job_tags: row.job_tags,
        aliases: row.aliases,
        step: row.step,
        is_final: row.is_final,
        is_best: row.is_best,
        is_last: row.is_last,
        metrics: row.metrics,
        data,
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
