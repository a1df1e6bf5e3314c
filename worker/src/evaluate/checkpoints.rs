//! The checkpoints of an evaluation or a control job, with their trainings and their names in
//! tables.

use evaluation::trained_on;
use models::{CONFIG_FILE, MODEL_FILE, TrainedModel};
use spec::{
    Baseline, CheckpointRef, ControlBaseline, DataSource, Digest, JobSpec, Normalization,
    SimulateSpec, TrainSpec, TrainingRef, TrainingStep,
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
    /// The name that people gave to it or to its run. Otherwise the training's name, which is the
    /// name in its pipeline if it has one.
    own_name: String,
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

    fn names(&self) -> Names {
        Names {
            shown: self.info.name.clone(),
            own: self.own_name.clone(),
            digest: self.info.digest.map(|digest| digest.short()).unwrap_or_default(),
        }
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
        let run = attempt.wait(store.run(checkpoint.run))?;
        let own_name = checkpoint.name.clone().unwrap_or(run.name);
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
        Ok(Self { info, model, step, own_name: own_name + &marks, trained_on })
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

/// Gives distinct names to checkpoints. Checkpoints of the same architecture get their own names.
/// The digest of the training is added where those are equal too, or the name of a baseline.
fn tell_apart(loaded: &mut [LoadedCheckpoint]) {
    let mut names: Vec<Names> = loaded.iter().map(LoadedCheckpoint::names).collect();
    distinguish(&mut names);
    for (checkpoint, names) in loaded.iter_mut().zip(names) {
        checkpoint.info.name = names.shown;
    }
}

/// The names that a checkpoint may have in a table.
struct Names {
    /// The present one; at first that of the architecture.
    shown: String,
    own: String,
    digest: String,
}

fn distinguish(checkpoints: &mut [Names]) {
    let steps: [fn(usize, &Names) -> String; 3] = [
        |_, names| names.own.clone(),
        |_, names| format!("{} {}", names.shown, names.digest),
        |place, names| format!("{} #{place}", names.shown),
    ];
    for rename in steps {
        let before: Vec<String> = checkpoints.iter().map(|names| names.shown.clone()).collect();
        for (place, names) in (1..).zip(checkpoints.iter_mut()) {
            let same = before.iter().filter(|shown| **shown == names.shown).count();
            if same > 1 || is_baseline(&names.shown) {
                names.shown = rename(place, names);
            }
        }
    }
}

fn is_baseline(name: &str) -> bool {
    Baseline::is_name(name) || ControlBaseline::all().iter().any(|known| known.as_str() == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(checkpoints: &[[&str; 3]]) -> Vec<String> {
        let of = |[architecture, own, digest]: &[&str; 3]| Names {
            shown: (*architecture).to_owned(),
            own: (*own).to_owned(),
            digest: (*digest).to_owned(),
        };
        let mut names: Vec<Names> = checkpoints.iter().map(of).collect();
        distinguish(&mut names);
        names.into_iter().map(|names| names.shown).collect()
    }

    #[test]
    fn checkpoints_of_one_architecture_have_their_own_names() {
        let found =
            shown(&[["cdt", "x", "1"], ["robomorph", "wide", "2"], ["robomorph", "y", "3"]]);
        assert_eq!(found, ["cdt", "wide", "y"]);
    }

    #[test]
    fn equal_names_are_told_apart_by_digests_and_then_by_their_places() {
        let found = shown(&[["cdt", "x", "1"], ["cdt", "x", "2"], ["robomorph", "x", "3"]]);
        assert_eq!(found, ["x 1", "x 2", "robomorph"]);
        let found = shown(&[["cdt", "robomorph", "1"], ["cdt", "x", "2"], ["robomorph", "x", "3"]]);
        assert_eq!(found, ["robomorph 1", "x", "robomorph 3"]);
        assert_eq!(shown(&[["cdt", "x", "1"], ["cdt", "x", "1"]]), ["x 1 #1", "x 1 #2"]);
    }

    /// The report gave the baseline's errors to a training that had its name.
    #[test]
    fn no_checkpoint_has_the_name_of_a_baseline() {
        let found = shown(&[["robomorph", "arx", "1"], ["robomorph", "oracle", "2"]]);
        assert_eq!(found, ["arx 1", "oracle 2"]);
    }
}
