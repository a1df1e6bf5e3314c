//! A study before it runs: trainings and evaluations with their purposes.

use serde_json::{Map, Value, json};

/// The question of one of a study's evaluations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum StudyQuestion {
    /// All frequencies, steps (on which nothing is trained), and latencies.
    Sweep,
    /// Frequencies of the trainings, with larger torques.
    Amplitude,
    /// Several predictions per scenario, scored as distributions.
    Samples,
    /// Other contexts and horizons.
    Lengths {
        /// Number of observed samples.
        context: u32,
        /// Number of predicted samples.
        horizon: u32,
    },
    /// Denoisers with fewer steps and warm starts.
    WarmStart,
    /// A question about arms as they are used, by its name in [`real_study`](crate::real_study).
    Arms(&'static str),
}

impl StudyQuestion {
    /// Whether its figures are in the report. Single figures about lengths, larger torques and other
    /// arms say little.
    pub fn is_drawn(self) -> bool {
        matches!(self, Self::Sweep | Self::Samples | Self::WarmStart)
    }

    /// Whether it is the question about arms as they are used that has this name.
    pub fn is_arms(self, name: &str) -> bool {
        matches!(self, Self::Arms(question) if question == name)
    }
}

/// One training of a study.
#[derive(Clone, Debug)]
pub struct StudyTraining {
    /// Its name in the pipeline.
    pub job: String,
    /// The model's name in tables.
    pub model: String,
    /// The number of the training set, see [`StudyEdition::set_name`](crate::StudyEdition::set_name).
    pub set: usize,
    /// The seed of its weights and batches.
    pub seed: u64,
    /// Context and horizon, if they are not the usual ones.
    pub length: Option<(u32, u32)>,
    pub(super) spec: Value,
}

/// One evaluation of a study.
#[derive(Clone, Debug)]
pub struct StudyEvaluation {
    /// Its name in the pipeline.
    pub job: String,
    /// Its question.
    pub question: StudyQuestion,
    /// The number of the training set, see [`StudyEdition::set_name`](crate::StudyEdition::set_name).
    pub set: usize,
    pub(super) spec: Value,
}

/// A study at one scale: all trainings and evaluations, with their purposes.
#[derive(Clone, Debug)]
pub struct StudyPlan {
    /// The simulations that trainings share, by their names in the pipeline.
    pub(super) simulations: Vec<(String, Value)>,
    /// The trainings, in the order of the pipeline.
    pub trainings: Vec<StudyTraining>,
    /// The evaluations, in the order of the pipeline.
    pub evaluations: Vec<StudyEvaluation>,
}

impl StudyPlan {
    /// The pipeline's JSON.
    pub fn pipeline(&self, name: &str) -> Value {
        let simulations = self.simulations.iter().cloned();
        let trainings =
            self.trainings.iter().map(|training| (training.job.clone(), training.spec.clone()));
        let evaluations = self
            .evaluations
            .iter()
            .map(|evaluation| (evaluation.job.clone(), evaluation.spec.clone()));
        let jobs: Map<String, Value> = simulations.chain(trainings).chain(evaluations).collect();
        json!({"kind": "pipeline", "name": name, "jobs": jobs})
    }
}

/// References to trainings as checkpoints.
pub(super) fn checkpoints<'a>(trainings: impl Iterator<Item = &'a StudyTraining>) -> Value {
    trainings.map(|training| json!({"job": training.job})).collect()
}
