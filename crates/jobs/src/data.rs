//! The trajectories and files that jobs read.

use spec::{DataSource, DataSpec, Digest, JobKind, JobSpec, Product, SpecError, TrainSpec};
use store::{Dataset, DatasetId, JobState, StoreError};

use crate::SubmissionError;
use crate::inputs::FoundData;
use crate::references::{FoundSpec, References, deleted, newest, no_such, stored};

impl References<'_> {
    pub async fn data(
        &self,
        source: &DataSource,
        field: &str,
    ) -> Result<FoundData, SubmissionError> {
        let mut asked = None;
        let found = match source {
            DataSource::Stream(spec) => {
                let spec = DataSpec::Simulation(spec.as_ref().clone());
                let source = source.clone();
                return Ok(FoundData { source, spec, need: None, dataset: None, asked: None });
            }
            DataSource::Job(name) => self.named(name, &format!("{field}.job"))?,
            DataSource::Dataset(id) => {
                let field = format!("{field}.dataset");
                let dataset = self.dataset(*id, &field).await?;
                let digest = dataset.digest;
                asked = Some(dataset);
                self.made(digest, Product::Trajectories, &field, &id.to_string()).await?
            }
            DataSource::Digest(digest) => {
                let field = format!("{field}.digest");
                self.made(*digest, Product::Trajectories, &field, &digest.to_string()).await?
            }
        };
        let FoundSpec { digest, need, spec, dataset } = found;
        let dataset = match dataset {
            Some(id) => Some(self.store.dataset(id).await?),
            None => None,
        };
        Ok(FoundData {
            source: DataSource::Digest(digest),
            spec: data_spec(&spec, field)?,
            need: Some(need),
            dataset,
            asked,
        })
    }

    async fn dataset(&self, id: i64, field: &str) -> Result<Dataset, SubmissionError> {
        match self.store.dataset(DatasetId(id)).await {
            Err(StoreError::NotFound { .. }) => {
                let newest = self.store.datasets(None, newest()).await?;
                Err(no_such(field, id, "dataset", newest.iter().map(|dataset| dataset.id.0)))
            }
            Err(error @ (StoreError::InTrash { .. } | StoreError::Purged { .. })) => {
                Err(deleted(field, id, &error))
            }
            found => Ok(found?),
        }
    }

    /// The first data that a training was trained on. Others have the same shape and rate.
    pub async fn trained_on(
        &self,
        training: &TrainSpec,
        field: &str,
    ) -> Result<DataSpec, SubmissionError> {
        let digest = match training.data.each().first() {
            Some(DataSource::Digest(digest)) => *digest,
            Some(DataSource::Stream(spec)) => {
                return Ok(DataSpec::Simulation(spec.as_ref().clone()));
            }
            Some(DataSource::Job(_) | DataSource::Dataset(_)) | None => {
                return Err(SpecError::one(field, "", "a training with resolved data").into());
            }
        };
        if let Some(sibling) = self.siblings.values().find(|sibling| sibling.digest == digest) {
            return Ok(data_spec(&sibling.spec, field)?);
        }
        match self.store.job_by_digest(digest, &JobState::ALL).await? {
            Some(job) => Ok(data_spec(&stored(&job, field)?, field)?),
            None => {
                let value = format!("trained on {digest}, which is unknown");
                Err(SpecError::one(field, value, "a training with known data").into())
            }
        }
    }

    /// The name of a file. Refuses one that nobody has sent.
    pub async fn check_sent(&self, file: Digest, field: &str) -> Result<String, SubmissionError> {
        if let Some(upload) = self.store.upload(file).await? {
            return Ok(upload.name);
        }
        let newest = self.store.newest_uploads(newest().limit).await?;
        let known: Vec<String> = newest
            .iter()
            .map(|upload| format!("{} ({})", upload.object.sha256, upload.name))
            .collect();
        let allowed = match known.as_slice() {
            [] => {
                "the SHA-256 of a file that was sent to POST /v1/datasets; none was yet".to_owned()
            }
            known => format!("the SHA-256 of a file that was sent: {}", known.join(", ")),
        };
        Err(SpecError::one(field, file.to_string(), allowed).into())
    }
}

fn data_spec(spec: &JobSpec, field: &str) -> Result<DataSpec, SpecError> {
    DataSpec::of(spec).ok_or_else(|| {
        let kinds: Vec<&str> =
            JobKind::making(Product::Trajectories).into_iter().map(JobKind::as_str).collect();
        SpecError::one(field, spec.kind().as_str(), kinds.join(", "))
    })
}
