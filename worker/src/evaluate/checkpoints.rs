use evaluation::trained_on;
use models::{CONFIG_FILE, MODEL_FILE, TrainedModel};
use spec::{
    CheckpointRef, DataSource, Digest, JobSpec, Normalization, SimulateSpec, TrainSpec,
    TrainingRef, TrainingStep,
};
use store::{JobState, WhichCheckpoint};
use wire::{PredictorInfo, PredictorKind, TrainedOn};

use crate::attempt::Attempt;
use crate::error::TaskError;

/// A checkpoint of an evaluation or a control job, with the known facts of its training.
pub(crate) struct LoadedCheckpoint {
    pub info: PredictorInfo,
    pub model: TrainedModel,
    /// Optimizer steps taken.
    pub step: u64,
    /// The training's name. It is the name in its pipeline if it has one.
    job: String,
    pub trained_on: Vec<TrainedOn>,
}

impl LoadedCheckpoint {
    /// All checkpoints of a job, in its order.
    pub fn load_all(
        attempt: &Attempt,
        checkpoints: &[CheckpointRef],
    ) -> Result<Vec<Self>, TaskError> {
        let mut loaded: Vec<Self> = checkpoints
            .iter()
            .map(|reference| Self::load(attempt, reference))
            .collect::<Result<_, _>>()?;
        tell_apart(&mut loaded);
        Ok(loaded)
    }

    fn load(attempt: &Attempt, reference: &CheckpointRef) -> Result<Self, TaskError> {
        let missing =
            |name: String| TaskError::Missing { what: "the checkpoint of training", name };
        // Submission replaced every other form of reference by one of these.
        let (digest, which, mark) = match reference {
            CheckpointRef::Digest(digest) => (digest, WhichCheckpoint::Final, String::new()),
            CheckpointRef::Best(TrainingRef::Digest(digest)) => {
                (digest, WhichCheckpoint::Best, " (best)".to_owned())
            }
            CheckpointRef::Step(TrainingStep { digest, step }) => {
                (digest, WhichCheckpoint::Step(*step), format!(" (step {step})"))
            }
            CheckpointRef::Job(_)
            | CheckpointRef::Checkpoint(_)
            | CheckpointRef::Best(TrainingRef::Job(_)) => {
                return Err(missing(format!("{reference:?}")));
            }
        };
        let store = &attempt.store;
        let checkpoint = attempt
            .wait(store.checkpoint_by_digest(*digest, which))?
            .ok_or_else(|| missing(format!("{digest}{mark}")))?;
        let read = |name| {
            let object = checkpoint.file(name).ok_or_else(|| missing(digest.to_string()))?;
            Ok::<_, TaskError>(attempt.wait(store.read_object(object))?)
        };
        let model = TrainedModel::load(&read(MODEL_FILE)?, &read(CONFIG_FILE)?, &attempt.device)?;
        let (id, step) = (checkpoint.id, checkpoint.step);
        tracing::info!(checkpoint = %id, job = %checkpoint.job, step, "loaded");

        // A checkpoint of a training that failed or was cancelled can be evaluated too.
        let job = attempt.wait(store.job(checkpoint.job))?;
        let job_name = job.name.clone();
        let JobSpec::Train(training) = serde_json::from_value(job.spec)? else {
            return Err(missing(digest.to_string()));
        };
        let data = match &training.data {
            DataSource::Digest(data) => match stored_spec(attempt, *data)? {
                JobSpec::Simulate(data) => Some(data),
                // Recordings do not say what excited the robots.
                _ => None,
            },
            DataSource::Stream(data) => Some(data.as_ref().clone()),
            DataSource::Job(_) | DataSource::Dataset(_) => None,
        };
        let trained_on =
            data.iter().flat_map(|data| trained_on(&data.excitation).collect::<Vec<_>>()).collect();
        let is_final = matches!(reference, CheckpointRef::Digest(_));
        let replicates =
            data.filter(|_| is_final).map(|data| without_seeds(training.clone(), data));
        let leaky = match training.normalization {
            Normalization::PaperLeaky => " (paper-leaky)",
            Normalization::Context | Normalization::Dataset | Normalization::None => "",
        };
        let marks = format!("{mark}{leaky}");
        let info = PredictorInfo {
            name: format!("{}{marks}", training.model.architecture()),
            kind: PredictorKind::Checkpoint,
            told: Some("the robots it was trained on".to_owned()),
            digest: Some(*digest),
            file: None,
            replicates,
            normalization: Some(training.normalization),
            sampling: None,
            latency: None,
        };
        Ok(Self { info, model, step, job: job_name + &marks, trained_on })
    }
}

/// The digest of a training and its simulated data without their seeds. Trainings that differ only
/// in seeds share it.
fn without_seeds(training: TrainSpec, data: SimulateSpec) -> Digest {
    let data = SimulateSpec { seed: 0, ..data };
    let data = match training.data {
        DataSource::Stream(_) => DataSource::Stream(Box::new(data)),
        _ => DataSource::Digest(JobSpec::Simulate(data).digest()),
    };
    JobSpec::Train(TrainSpec { seed: 0, data, ..training }).digest()
}

/// The spec of a succeeded job with this digest.
fn stored_spec(attempt: &Attempt, digest: Digest) -> Result<JobSpec, TaskError> {
    let job = attempt
        .wait(attempt.store.job_by_digest(digest, &[JobState::Succeeded]))?
        .ok_or_else(|| TaskError::Missing { what: "the job of spec", name: digest.to_string() })?;
    Ok(serde_json::from_value(job.spec)?)
}

/// Gives distinct names to checkpoints. Checkpoints of the same architecture get the names of their
/// trainings in a pipeline. Where those are equal too, the digest is added.
fn tell_apart(loaded: &mut [LoadedCheckpoint]) {
    rename_shared(loaded, |checkpoint| checkpoint.job.clone());
    rename_shared(loaded, |checkpoint| {
        let digest = checkpoint.info.digest.map(|digest| digest.short()).unwrap_or_default();
        format!("{} {digest}", checkpoint.info.name)
    });
}

fn rename_shared(loaded: &mut [LoadedCheckpoint], name: impl Fn(&LoadedCheckpoint) -> String) {
    let names: Vec<String> = loaded.iter().map(|checkpoint| checkpoint.info.name.clone()).collect();
    for checkpoint in loaded {
        if names.iter().filter(|name| **name == checkpoint.info.name).count() > 1 {
            checkpoint.info.name = name(checkpoint);
        }
    }
}
