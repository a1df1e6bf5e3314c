//! Resolves the references of a spec: finds what they refer to, checks that it can be used, and
//! replaces them by digests.

use std::collections::BTreeMap;

use spec::{
    DataSource, Digest, JobKind, JobSpec, Product, Reference, Referred, SpecError, TrainSpec,
};
use store::{DatasetId, Job, JobFilter, JobState, Need, Page, Store, StoreError};

use crate::SubmissionError;
use crate::inputs::Inputs;

/// Number of existing ids that an error names.
const EXISTING_SHOWN: u32 = 10;

/// States of jobs whose results exist or are being made.
const LIVE: [JobState; 3] = [JobState::Waiting, JobState::Queued, JobState::Running];

/// Resolves the references of a job, or of the jobs of a pipeline one after the other.
pub(crate) struct References<'a> {
    pub store: &'a Store,
    /// The jobs of the pipeline that were resolved before, by name.
    pub siblings: BTreeMap<String, Sibling>,
}

/// A resolved job of the same pipeline.
pub(crate) struct Sibling {
    /// Index among the jobs of the submission.
    pub index: usize,
    pub digest: Digest,
    pub spec: JobSpec,
}

/// A job with its references resolved, and its inputs.
pub(crate) struct Resolved {
    pub spec: JobSpec,
    pub inputs: Inputs,
}

/// The digest of a needed spec, and the job that makes its result.
pub(crate) struct FoundSpec {
    pub digest: Digest,
    pub need: Need,
    pub spec: JobSpec,
    /// The dataset that this job fills, if it fills one and exists already.
    pub dataset: Option<DatasetId>,
}

impl<'a> References<'a> {
    pub fn new(store: &'a Store) -> Self {
        Self { store, siblings: BTreeMap::new() }
    }

    /// Lets later jobs of the pipeline refer to the `index`-th by `name`.
    pub fn add_sibling(&mut self, name: &str, index: usize, spec: &JobSpec) {
        let sibling = Sibling { index, digest: spec.digest(), spec: spec.clone() };
        self.siblings.insert(name.to_owned(), sibling);
    }

    /// The index of a sibling that was added.
    pub fn sibling(&self, name: &str) -> Option<usize> {
        self.siblings.get(name).map(|sibling| sibling.index)
    }

    /// # Errors
    /// [`SubmissionError::Spec`] when `spec` refers to something that does not exist or has failed.
    pub async fn resolve(&self, spec: &JobSpec) -> Result<Resolved, SubmissionError> {
        let mut spec = spec.clone();
        let mut inputs = Inputs::default();
        let mut unsent = SpecError::default();
        for Reference { field, to } in spec.references() {
            match to {
                Referred::Data(source) => {
                    let data = self.data(source, &field).await?;
                    *source = data.source.clone();
                    inputs.needs.extend(data.need);
                    if let DataSource::Digest(digest) = &data.source {
                        inputs.reads.push(*digest);
                    }
                    inputs.data.push(data);
                }
                Referred::Checkpoint(reference) => {
                    let checkpoint = self.checkpoint(reference, &field).await?;
                    let training = training(&checkpoint.training, &field)?;
                    if inputs.checkpoints.contains(&checkpoint.reference) {
                        let value = serde_json::to_string(&checkpoint.reference);
                        let value = value.unwrap_or_default();
                        return Err(SpecError::one(field, value, "each checkpoint once").into());
                    }
                    let data = self.trained_on(&training, &field).await?;
                    *reference = checkpoint.reference.clone();
                    inputs.needs.extend(checkpoint.need);
                    inputs.reads.push(checkpoint.digest);
                    inputs.existing.extend(checkpoint.existing);
                    inputs.checkpoints.push(checkpoint.reference);
                    inputs.trainings.push((training, data));
                }
                Referred::File(file) => match self.check_sent(*file, &field).await {
                    Ok(name) => {
                        inputs.files.push(*file);
                        inputs.file_names.push(name);
                    }
                    Err(SubmissionError::Spec(error)) => unsent.append(error),
                    Err(other) => return Err(other),
                },
            }
        }
        unsent.into_result()?;
        if let Some(data) = inputs.data.first() {
            spec.fit_to_data(&data.spec);
        }
        Ok(Resolved { spec, inputs })
    }

    pub fn named(&self, name: &str, field: &str) -> Result<FoundSpec, SubmissionError> {
        let Some(sibling) = self.siblings.get(name) else {
            let names: Vec<&str> = self.siblings.keys().map(String::as_str).collect();
            let allowed = format!("a job of this pipeline: {}", names.join(", "));
            return Err(SpecError::one(field, format!("{name:?}"), allowed).into());
        };
        Ok(FoundSpec {
            digest: sibling.digest,
            need: Need::New(sibling.index),
            spec: sibling.spec.clone(),
            dataset: None,
        })
    }

    /// The job that made, or will make, the `product` with this digest.
    pub async fn made(
        &self,
        digest: Digest,
        product: Product,
        field: &str,
        value: &str,
    ) -> Result<FoundSpec, SubmissionError> {
        let fitting = |job: Option<Job>| job.filter(|job| makes(job, product));
        let mut job =
            fitting(self.store.usable_job_by_digest(digest, &[JobState::Succeeded]).await?);
        if job.is_none() {
            let live = fitting(self.store.usable_job_by_digest(digest, &LIVE).await?);
            job = live.filter(|job| !job.cancel_requested);
        }
        let Some(job) = job else {
            return Err(self.missing_result(digest, product, field, value).await?.into());
        };
        Ok(FoundSpec {
            digest,
            need: Need::Existing(job.id),
            spec: stored(&job, field)?,
            dataset: job.dataset,
        })
    }

    async fn missing_result(
        &self,
        digest: Digest,
        product: Product,
        field: &str,
        value: &str,
    ) -> Result<SpecError, SubmissionError> {
        let any = self.store.job_by_digest(digest, &JobState::ALL).await?;
        if let Some(job) = any.filter(|job| makes(job, product)) {
            let state = if job.cancel_requested { JobState::Cancelled } else { job.state };
            if state == JobState::Succeeded {
                let value =
                    format!("{value}, of {} job {}, whose results were deleted", job.kind, job.id);
                let allowed =
                    "of a job whose results exist; restore them, or submit its spec again";
                return Ok(SpecError::one(field, value, allowed));
            }
            let value = format!("{value}, of {} job {}, which {}", job.kind, job.id, ended(state));
            return Ok(SpecError::one(
                field,
                value,
                "of a job that succeeded or can still succeed",
            ));
        }
        let kinds: Vec<&str> = JobKind::making(product).into_iter().map(JobKind::as_str).collect();
        let mut existing = Vec::new();
        for kind in &kinds {
            let filter = JobFilter { kind: Some(kind), ..JobFilter::default() };
            existing.extend(self.store.jobs(filter, newest()).await?);
        }
        let digests: Vec<String> = existing
            .iter()
            .filter(|job| !matches!(job.state, JobState::Failed | JobState::Cancelled))
            .map(|job| job.digest.to_string())
            .collect();
        let kind = kinds.join(" or ");
        let allowed = match digests.as_slice() {
            [] => format!("the digest of a job of kind {kind}; there is none yet"),
            digests => format!("the digest of a job of kind {kind}: {}", digests.join(", ")),
        };
        Ok(SpecError::one(field, value, allowed))
    }
}

fn makes(job: &Job, product: Product) -> bool {
    job.kind.parse::<JobKind>().is_ok_and(|kind| kind.makes() == Some(product))
}

/// The page of a list that errors name as existing.
pub(crate) const fn newest() -> Page {
    Page { before: None, limit: EXISTING_SHOWN }
}

fn ended(state: JobState) -> &'static str {
    match state {
        JobState::Failed => "failed",
        JobState::Cancelled => "was cancelled",
        _ => "has not ended",
    }
}

pub(crate) fn no_such(
    field: &str,
    id: i64,
    what: &str,
    existing: impl Iterator<Item = i64>,
) -> SubmissionError {
    let ids: Vec<String> = existing.map(|id| id.to_string()).collect();
    let allowed = match ids.as_slice() {
        [] => format!("the id of a {what}; there is none yet"),
        ids => format!("the id of a {what}, the newest are {}", ids.join(", ")),
    };
    SpecError::one(field, id.to_string(), allowed).into()
}

/// The error for an item that was deleted.
pub(crate) fn deleted(field: &str, id: i64, error: &StoreError) -> SubmissionError {
    SpecError::one(field, format!("{id}: {error}"), "the id of something that is not deleted")
        .into()
}

/// The spec of a stored job. It was resolved before it was stored.
pub(crate) fn stored(job: &Job, field: &str) -> Result<JobSpec, SpecError> {
    serde_json::from_value(job.spec.clone()).map_err(|error| {
        let value = format!("of job {}, whose spec this version cannot read: {error}", job.id);
        SpecError::one(field, value, "of a job of this version")
    })
}

pub(crate) fn training(spec: &JobSpec, field: &str) -> Result<TrainSpec, SpecError> {
    match spec {
        JobSpec::Train(spec) => Ok(spec.clone()),
        other => Err(SpecError::one(field, other.kind().as_str(), JobKind::Train.as_str())),
    }
}
