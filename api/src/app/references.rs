//! What a spec refers to: found, checked to be usable, and replaced by its digest.

use std::collections::BTreeMap;

use spec::{
    CheckpointRef, ControlSpec, DataSource, DataSpec, Digest, EvaluateSpec, JobKind, JobSpec,
    SpecError, TrainSpec, Training, TrainingRef, TrainingStep, VerifySpec,
};
use store::{
    Checkpoint, CheckpointId, DatasetId, DatasetState, Job, JobFilter, JobState, Need, Page, Store,
    StoreError, WhichCheckpoint,
};

use crate::app::uploads;
use crate::error::ApiError;

/// How many ids an error names as what exists.
const EXISTING_SHOWN: u32 = 10;

/// States of jobs whose results exist or are on their way.
const LIVE: [JobState; 3] = [JobState::Waiting, JobState::Queued, JobState::Running];

/// Kinds of jobs that make datasets.
const DATA_KINDS: &[JobKind] = &[JobKind::Simulate, JobKind::Import];

/// Resolves the references of a job, or of the jobs of a pipeline one after the other.
pub struct References<'a> {
    store: &'a Store,
    /// The jobs of the pipeline that were resolved before, by name.
    siblings: BTreeMap<String, Sibling>,
}

/// A resolved job of the same pipeline.
struct Sibling {
    index: usize,
    digest: Digest,
    spec: JobSpec,
}

/// A job with every reference resolved, and what follows from them.
pub struct Resolved {
    pub spec: JobSpec,
    pub needs: Vec<Need>,
    /// What it reads, if it reads trajectories.
    pub data: Option<DataSpec>,
    /// The one dataset that a verification looks at, if it exists already.
    pub dataset: Option<DatasetId>,
}

/// The trajectories that a job reads.
struct FoundData {
    source: DataSource,
    /// The job that makes them, unless they are a stream.
    need: Option<Need>,
    spec: DataSpec,
    /// What that job fills, if it exists already.
    dataset: Option<DatasetId>,
}

/// Something that a job needs: the digest of its spec, and the job that makes it.
struct Found {
    digest: Digest,
    need: Need,
    spec: JobSpec,
    dataset: Option<DatasetId>,
}

/// The checkpoints that a job asks for, by digest, and what follows from them.
struct TrainedCheckpoints {
    references: Vec<CheckpointRef>,
    needs: Vec<Need>,
    trainings: Vec<(TrainSpec, DataSpec)>,
}

/// A checkpoint that a job asks for, and its training.
struct FoundCheckpoint {
    /// By digest.
    reference: CheckpointRef,
    /// The training, unless the checkpoint is there already.
    need: Option<Need>,
    training: JobSpec,
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
    /// [`ApiError::Spec`] when something that `spec` refers to does not exist, has failed, or does
    /// not fit.
    pub async fn resolve(&self, spec: &JobSpec) -> Result<Resolved, ApiError> {
        match spec {
            JobSpec::Train(spec) => self.resolve_training(spec).await,
            JobSpec::Evaluate(spec) => self.resolve_evaluation(spec).await,
            JobSpec::Control(spec) => self.resolve_control(spec).await,
            JobSpec::Verify(spec) => self.resolve_verification(spec).await,
            JobSpec::Import(import) => {
                uploads::check_known(self.store, import).await?;
                Ok(Resolved { spec: spec.clone(), needs: Vec::new(), data: None, dataset: None })
            }
            JobSpec::Simulate(_) | JobSpec::Pipeline(_) => {
                Ok(Resolved { spec: spec.clone(), needs: Vec::new(), data: None, dataset: None })
            }
        }
    }

    async fn resolve_training(&self, spec: &TrainSpec) -> Result<Resolved, ApiError> {
        let data = self.data(&spec.data).await?;
        spec.check_data(&data.spec)?;
        // Of an import only the dataset tells how much there is, once there is one.
        if let (None, Some(id)) = (data.spec.trajectories(), data.dataset) {
            let dataset = self.store.dataset(id).await?;
            if dataset.state == DatasetState::Complete {
                spec.check_trajectories(dataset.trajectories)?;
            }
        }
        let spec = TrainSpec { data: data.source, ..spec.clone() };
        let needs = data.need.into_iter().collect();
        Ok(Resolved { spec: JobSpec::Train(spec), needs, data: Some(data.spec), dataset: None })
    }

    /// A verification of a dataset looks at that one, and not at another with the same digest.
    async fn resolve_verification(&self, spec: &VerifySpec) -> Result<Resolved, ApiError> {
        let data = self.data(&spec.data).await?;
        let (need, dataset) = match &spec.data {
            DataSource::Dataset(id) => {
                let dataset = self.store.dataset(DatasetId(*id)).await?;
                (Some(Need::Existing(dataset.job)), Some(dataset.id))
            }
            _ => (data.need, data.dataset),
        };
        let spec = VerifySpec { data: data.source, ..spec.clone() };
        let needs = need.into_iter().collect();
        Ok(Resolved { spec: JobSpec::Verify(spec), needs, data: Some(data.spec), dataset })
    }

    async fn resolve_evaluation(&self, spec: &EvaluateSpec) -> Result<Resolved, ApiError> {
        let data = self.data(&spec.data).await?;
        let mut needs: Vec<Need> = data.need.into_iter().collect();
        let found = self.trained_checkpoints(&spec.checkpoints).await?;
        spec.check_inputs(&data.spec, &found.inputs())?;
        needs.extend(found.needs);
        let spec =
            EvaluateSpec { data: data.source, checkpoints: found.references, ..spec.clone() };
        Ok(Resolved { spec: JobSpec::Evaluate(spec), needs, data: Some(data.spec), dataset: None })
    }

    async fn resolve_control(&self, spec: &ControlSpec) -> Result<Resolved, ApiError> {
        let data = self.data(&spec.data).await?;
        let mut needs: Vec<Need> = data.need.into_iter().collect();
        let found = self.trained_checkpoints(&spec.checkpoints).await?;
        spec.check_inputs(&data.spec, &found.inputs())?;
        needs.extend(found.needs);
        let spec = ControlSpec { data: data.source, checkpoints: found.references, ..spec.clone() };
        Ok(Resolved { spec: JobSpec::Control(spec), needs, data: Some(data.spec), dataset: None })
    }

    /// The checkpoints of an evaluation or a control job, each with its training.
    async fn trained_checkpoints(
        &self,
        references: &[CheckpointRef],
    ) -> Result<TrainedCheckpoints, ApiError> {
        let mut needs = Vec::new();
        let mut checkpoints = Vec::with_capacity(references.len());
        let mut trainings = Vec::with_capacity(references.len());
        for (i, reference) in references.iter().enumerate() {
            let field = format!("checkpoints[{i}]");
            let checkpoint = self.checkpoint(reference, &field).await?;
            let training = training(&checkpoint.training, &field)?;
            if checkpoints.contains(&checkpoint.reference) {
                let value = serde_json::to_string(&checkpoint.reference).unwrap_or_default();
                return Err(SpecError::one(field, value, "each checkpoint once").into());
            }
            let data = self.data_of(&training, &field).await?;
            needs.extend(checkpoint.need);
            checkpoints.push(checkpoint.reference);
            trainings.push((training, data));
        }
        Ok(TrainedCheckpoints { references: checkpoints, needs, trainings })
    }

    async fn data(&self, source: &DataSource) -> Result<FoundData, ApiError> {
        let found = match source {
            DataSource::Stream(spec) => {
                let spec = DataSpec::Simulation(spec.as_ref().clone());
                return Ok(FoundData { source: source.clone(), need: None, spec, dataset: None });
            }
            DataSource::Job(name) => self.named(name, "data.job")?,
            DataSource::Dataset(id) => self.dataset(*id).await?,
            DataSource::Digest(digest) => {
                self.made(*digest, DATA_KINDS, "data.digest", &digest.to_string()).await?
            }
        };
        let spec = data_spec(&found.spec, "data")?;
        Ok(FoundData {
            source: DataSource::Digest(found.digest),
            need: Some(found.need),
            spec,
            dataset: found.dataset,
        })
    }

    async fn dataset(&self, id: i64) -> Result<Found, ApiError> {
        match self.store.dataset(DatasetId(id)).await {
            Ok(dataset) => {
                self.made(dataset.digest, DATA_KINDS, "data.dataset", &id.to_string()).await
            }
            Err(StoreError::NotFound { .. }) => {
                let newest = self.store.datasets(None, newest()).await?;
                let ids = newest.iter().map(|dataset| dataset.id.0);
                Err(no_such("data.dataset", id, "dataset", ids))
            }
            Err(error) => Err(error.into()),
        }
    }

    async fn checkpoint(
        &self,
        reference: &CheckpointRef,
        field: &str,
    ) -> Result<FoundCheckpoint, ApiError> {
        match reference {
            CheckpointRef::Job(name) => {
                let found = self.named(name, &format!("{field}.job"))?;
                Ok(FoundCheckpoint::of(found, CheckpointRef::Digest))
            }
            CheckpointRef::Digest(digest) => {
                let found = self.trained(*digest, &format!("{field}.digest")).await?;
                Ok(FoundCheckpoint::of(found, CheckpointRef::Digest))
            }
            CheckpointRef::Best(of) => {
                let found = match of {
                    TrainingRef::Job(name) => self.named(name, &format!("{field}.best.job"))?,
                    TrainingRef::Digest(digest) => {
                        self.trained(*digest, &format!("{field}.best.digest")).await?
                    }
                };
                let field = format!("{field}.best");
                if training(&found.spec, &field)?.validation_fraction == 0.0 {
                    let value = "of a training without validation";
                    let allowed = "of one with a validation_fraction above 0";
                    return Err(SpecError::one(field, value, allowed).into());
                }
                let best = |digest| CheckpointRef::Best(TrainingRef::Digest(digest));
                Ok(FoundCheckpoint::of(found, best))
            }
            CheckpointRef::Checkpoint(id) => {
                let field = format!("{field}.checkpoint");
                match self.store.checkpoint(CheckpointId(*id)).await {
                    Ok(checkpoint) => self.existing(checkpoint, &field).await,
                    Err(StoreError::NotFound { .. }) => {
                        let newest = self.store.checkpoints(newest()).await?;
                        let ids = newest.iter().map(|checkpoint| checkpoint.id.0);
                        Err(no_such(&field, *id, "checkpoint", ids))
                    }
                    Err(error) => Err(error.into()),
                }
            }
            CheckpointRef::Step(TrainingStep { digest, step }) => {
                let field = format!("{field}.step");
                let which = WhichCheckpoint::Step(*step);
                match self.store.checkpoint_by_digest(*digest, which).await? {
                    Some(checkpoint) => self.existing(checkpoint, &field).await,
                    None => {
                        let value = format!("{digest} after step {step}");
                        let allowed = "a checkpoint that is kept, see the list of a training's";
                        Err(SpecError::one(field, value, allowed).into())
                    }
                }
            }
        }
    }

    /// A checkpoint that is there: nothing has to succeed first, and its training may even have
    /// failed. The final one is that of every training with the digest.
    async fn existing(
        &self,
        checkpoint: Checkpoint,
        field: &str,
    ) -> Result<FoundCheckpoint, ApiError> {
        let training = stored(&self.store.job(checkpoint.job).await?, field)?;
        let reference = if checkpoint.is_final {
            CheckpointRef::Digest(checkpoint.digest)
        } else {
            let Checkpoint { digest, step, .. } = checkpoint;
            CheckpointRef::Step(TrainingStep { digest, step })
        };
        Ok(FoundCheckpoint { reference, need: None, training })
    }

    async fn trained(&self, digest: Digest, field: &str) -> Result<Found, ApiError> {
        self.made(digest, &[JobKind::Train], field, &digest.to_string()).await
    }

    fn named(&self, name: &str, field: &str) -> Result<Found, ApiError> {
        let Some(sibling) = self.siblings.get(name) else {
            let names: Vec<&str> = self.siblings.keys().map(String::as_str).collect();
            let allowed = format!("a job of this pipeline: {}", names.join(", "));
            return Err(SpecError::one(field, format!("{name:?}"), allowed).into());
        };
        Ok(Found {
            digest: sibling.digest,
            need: Need::New(sibling.index),
            spec: sibling.spec.clone(),
            dataset: None,
        })
    }

    /// The job of one of `kinds` that has made, or is going to make, what `digest` names.
    async fn made(
        &self,
        digest: Digest,
        kinds: &[JobKind],
        field: &str,
        value: &str,
    ) -> Result<Found, ApiError> {
        let of_kind = |job: Option<Job>| job.filter(|job| is_of(job, kinds));
        let mut job = of_kind(self.store.job_by_digest(digest, &[JobState::Succeeded]).await?);
        if job.is_none() {
            let live = of_kind(self.store.job_by_digest(digest, &LIVE).await?);
            job = live.filter(|job| !job.cancel_requested);
        }
        let Some(job) = job else {
            return Err(self.not_made(digest, kinds, field, value).await?.into());
        };
        Ok(Found {
            digest,
            need: Need::Existing(job.id),
            spec: stored(&job, field)?,
            dataset: job.dataset,
        })
    }

    async fn not_made(
        &self,
        digest: Digest,
        kinds: &[JobKind],
        field: &str,
        value: &str,
    ) -> Result<SpecError, ApiError> {
        let any = self.store.job_by_digest(digest, &JobState::ALL).await?;
        if let Some(job) = any.filter(|job| is_of(job, kinds)) {
            let state = if job.cancel_requested { JobState::Cancelled } else { job.state };
            let value = format!("{value}, of {} job {}, which {}", job.kind, job.id, ended(state));
            return Ok(SpecError::one(field, value, "of a job that succeeded or still can"));
        }
        let mut existing = Vec::new();
        for kind in kinds {
            let filter = JobFilter { kind: Some(kind.as_str()), ..JobFilter::default() };
            existing.extend(self.store.jobs(filter, newest()).await?);
        }
        let digests: Vec<String> = existing
            .iter()
            .filter(|job| !matches!(job.state, JobState::Failed | JobState::Cancelled))
            .map(|job| job.digest.to_string())
            .collect();
        let names: Vec<&str> = kinds.iter().map(|kind| kind.as_str()).collect();
        let kind = names.join(" or ");
        let allowed = match digests.as_slice() {
            [] => format!("the digest of a job of kind {kind}, of which there are none yet"),
            digests => format!("the digest of a job of kind {kind}: {}", digests.join(", ")),
        };
        Ok(SpecError::one(field, value, allowed))
    }

    /// What a training was trained on.
    async fn data_of(&self, training: &TrainSpec, field: &str) -> Result<DataSpec, ApiError> {
        let digest = match &training.data {
            DataSource::Digest(digest) => *digest,
            DataSource::Stream(spec) => return Ok(DataSpec::Simulation(spec.as_ref().clone())),
            DataSource::Job(_) | DataSource::Dataset(_) => {
                return Err(SpecError::one(field, "", "a training with resolved data").into());
            }
        };
        if let Some(sibling) = self.siblings.values().find(|it| it.digest == digest) {
            return data_spec(&sibling.spec, field);
        }
        match self.store.job_by_digest(digest, &JobState::ALL).await? {
            Some(job) => data_spec(&stored(&job, field)?, field),
            None => {
                let value = format!("trained on {digest}, of which nothing is known");
                Err(SpecError::one(field, value, "a training with known data").into())
            }
        }
    }
}

impl TrainedCheckpoints {
    fn inputs(&self) -> Vec<Training<'_>> {
        self.trainings.iter().map(|(spec, data)| Training { spec, data }).collect()
    }
}

impl FoundCheckpoint {
    fn of(found: Found, reference: impl Fn(Digest) -> CheckpointRef) -> Self {
        Self { reference: reference(found.digest), need: Some(found.need), training: found.spec }
    }
}

fn is_of(job: &Job, kinds: &[JobKind]) -> bool {
    kinds.iter().any(|kind| job.kind == kind.as_str())
}

fn newest() -> Page {
    Page { before: None, limit: EXISTING_SHOWN }
}

fn ended(state: JobState) -> &'static str {
    match state {
        JobState::Failed => "failed",
        JobState::Cancelled => "was cancelled",
        _ => "has not ended",
    }
}

fn no_such(field: &str, id: i64, what: &str, existing: impl Iterator<Item = i64>) -> ApiError {
    let ids: Vec<String> = existing.map(|id| id.to_string()).collect();
    let allowed = match ids.as_slice() {
        [] => format!("the id of a {what}, of which there are none yet"),
        ids => format!("the id of a {what}, the newest are {}", ids.join(", ")),
    };
    SpecError::one(field, id.to_string(), allowed).into()
}

/// The spec of a stored job; it was resolved when it was stored.
fn stored(job: &Job, field: &str) -> Result<JobSpec, ApiError> {
    serde_json::from_value(job.spec.clone()).map_err(|error| {
        let value = format!("of job {}, whose spec this version cannot read: {error}", job.id);
        SpecError::one(field, value, "of a job of this version").into()
    })
}

fn data_spec(spec: &JobSpec, field: &str) -> Result<DataSpec, ApiError> {
    DataSpec::of(spec)
        .ok_or_else(|| SpecError::one(field, spec.kind().as_str(), "simulate, import").into())
}

fn training(spec: &JobSpec, field: &str) -> Result<TrainSpec, ApiError> {
    match spec {
        JobSpec::Train(spec) => Ok(spec.clone()),
        other => Err(SpecError::one(field, other.kind().as_str(), "train").into()),
    }
}
