//! The checkpoints of an evaluation or a control job, with their trainings and their names in
//! tables.

use evaluation::{trained_on, trained_on_together};
use models::{CONFIG_FILE, MODEL_FILE, TrainedModel};
use spec::{
    Baseline, CheckpointRef, ControlBaseline, DataSource, DataSources, Digest, JobSpec,
    Normalization, SimulateSpec, TrainSpec, TrainingRef, TrainingStep,
};
use store::JobState;
use wire::{PredictorInfo, PredictorKind, TrainedOn};

use crate::attempt::Attempt;
use crate::checkpoint::{self, FoundCheckpoint};
use crate::error::TaskError;

/// A checkpoint of an evaluation or a control job, with the known facts of its training.
pub(crate) struct LoadedCheckpoint {
    pub info: PredictorInfo,
    pub model: TrainedModel,
    /// Optimizer steps taken.
    pub step: u64,
    /// SHA-256 of its weights.
    pub weights: Option<Digest>,
    /// The name that people gave to it or to its run. Otherwise the training's name, which is the
    /// name in its pipeline if it has one.
    own_name: String,
    pub trained_on: Vec<TrainedOn>,
    /// The data of its training and of those that it began from.
    data: Vec<DataSource>,
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

    /// Whether it was trained on this data, or on robots of the same stream.
    pub fn was_trained_on(&self, data: &DataSource) -> bool {
        self.data.contains(&of_any_length(data))
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
        let store = &attempt.store;
        let FoundCheckpoint { checkpoint, training: digest, mark } =
            checkpoint::find(attempt, reference)?;
        let read = |name| checkpoint::read(attempt, &checkpoint, name);
        let model = TrainedModel::load(&read(MODEL_FILE)?, &read(CONFIG_FILE)?, &attempt.device)?;
        let (id, step) = (checkpoint.id, checkpoint.step);
        let weights = checkpoint.file(MODEL_FILE).map(|file| file.sha256);
        tracing::info!(checkpoint = %id, job = %checkpoint.job, step, "loaded");

        // A checkpoint of a training that failed or was cancelled can be evaluated too.
        let job = attempt.wait(store.job(checkpoint.job))?;
        let run = attempt.wait(store.run(checkpoint.run))?;
        let own_name = checkpoint.name.clone().unwrap_or(run.name);
        let JobSpec::Train(training) = serde_json::from_value(job.spec)? else {
            return Err(missing(digest.to_string()));
        };
        let lineage = Lineage::of(attempt, &training)?;
        let is_final = matches!(reference, CheckpointRef::Digest(_));
        let replicates = lineage.replicates.filter(|_| is_final);
        let leaky = match training.normalization {
            Normalization::PaperLeaky => " (paper-leaky)",
            Normalization::Context | Normalization::Dataset | Normalization::None => "",
        };
        let marks = format!("{mark}{leaky}");
        let info = PredictorInfo {
            name: format!("{}{marks}", training.model.architecture()),
            kind: PredictorKind::Checkpoint,
            told: Some(prior_knowledge(&training)),
            digest: Some(digest),
            file: None,
            replicates,
            normalization: Some(training.normalization),
            sampling: None,
            latency: None,
        };
        Ok(Self {
            info,
            model,
            step,
            weights,
            own_name: own_name + &marks,
            trained_on: trained_on_together(lineage.trained_on),
            data: lineage.data,
        })
    }
}

/// The knowledge of a model before it sees a context.
fn prior_knowledge(training: &TrainSpec) -> String {
    let trained = "the robots it was trained on".to_owned();
    match training.model.robot() {
        Some(_) => trained + ", the arm's description",
        None => trained,
    }
}

/// Everything that the weights of a training come from.
struct Lineage {
    /// The excitations of the simulated robots, of this training and of those that it began from.
    trained_on: Vec<TrainedOn>,
    /// The data of this training and of those that it began from.
    data: Vec<DataSource>,
    /// The digest of the training, of its simulated data and of the trainings before it without
    /// their seeds. Trainings that differ only in seeds share it.
    replicates: Option<Digest>,
}

impl Lineage {
    fn of(attempt: &Attempt, training: &TrainSpec) -> Result<Self, TaskError> {
        let mut lineage = Self {
            trained_on: Vec::new(),
            data: training.data.each().iter().map(of_any_length).collect(),
            replicates: None,
        };
        let mut unseeded = Some(TrainSpec { seed: 0, ..training.clone() });
        let mut sources = Vec::new();
        for source in training.data.each() {
            let simulated = match source {
                DataSource::Digest(data) => match stored_spec(attempt, *data)? {
                    Some(JobSpec::Simulate(data)) => Some(data),
                    // Recordings have no seed, and do not say what excited the robots. Nor does data
                    // that was purged.
                    _ => None,
                },
                DataSource::Stream(data) => Some(data.as_ref().clone()),
                DataSource::Job(_) | DataSource::Dataset(_) => None,
            };
            let Some(data) = simulated else {
                sources.push(source.clone());
                continue;
            };
            lineage.trained_on.extend(trained_on(&data.excitation));
            let data = SimulateSpec { seed: 0, ..data };
            sources.push(match source {
                DataSource::Stream(_) => DataSource::Stream(Box::new(data)),
                _ => DataSource::Digest(JobSpec::Simulate(data).digest()),
            });
        }
        if let Some(init) = &training.init {
            let spec = match checkpoint::training_of(init) {
                Some(digest) => stored_spec(attempt, digest)?,
                None => None,
            };
            // The checkpoint may be gone, and even its training. Nobody knows then what it saw.
            let earlier = match spec {
                Some(JobSpec::Train(earlier)) => Some(Self::of(attempt, &earlier)?),
                _ => None,
            };
            let replicates = earlier.as_ref().and_then(|earlier| earlier.replicates);
            let same = replicates.and_then(|digest| of_training(init, digest));
            unseeded = unseeded.and_then(|spec| Some(TrainSpec { init: Some(same?), ..spec }));
            if let Some(earlier) = earlier {
                lineage.trained_on.extend(earlier.trained_on);
                lineage.data.extend(earlier.data);
            }
        }
        lineage.replicates = unseeded.map(|spec| {
            let data = match &spec.data {
                DataSources::One(_) => DataSources::One(sources.remove(0)),
                DataSources::Each(_) => DataSources::Each(sources),
            };
            JobSpec::Train(TrainSpec { data, ..spec }).digest()
        });
        Ok(lineage)
    }
}

/// The data without the number of trajectories, if it is a stream: robot `i` does not depend on it.
fn of_any_length(data: &DataSource) -> DataSource {
    match data {
        DataSource::Stream(spec) => DataSource::Stream(Box::new(SimulateSpec {
            trajectories: 0,
            shard_trajectories: 0,
            ..spec.as_ref().clone()
        })),
        other => other.clone(),
    }
}

/// The same checkpoint of the training with this digest.
fn of_training(checkpoint: &CheckpointRef, digest: Digest) -> Option<CheckpointRef> {
    match checkpoint {
        CheckpointRef::Digest(_) => Some(CheckpointRef::Digest(digest)),
        CheckpointRef::Best(_) => Some(CheckpointRef::Best(TrainingRef::Digest(digest))),
        CheckpointRef::Step(TrainingStep { step, .. }) => {
            Some(CheckpointRef::Step(TrainingStep { digest, step: *step }))
        }
        CheckpointRef::Job(_) | CheckpointRef::Checkpoint(_) | CheckpointRef::Alias(_) => None,
    }
}

/// The spec of a job with this digest, if there is one.
fn stored_spec(attempt: &Attempt, digest: Digest) -> Result<Option<JobSpec>, TaskError> {
    let job = attempt.wait(attempt.store.job_by_digest(digest, &JobState::ALL))?;
    Ok(job.map(|job| serde_json::from_value(job.spec)).transpose()?)
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
