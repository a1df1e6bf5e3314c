//! The study of the paper, second edition. It is a pipeline made from a list of models
//! (`study/paper.json`, one per line) and the sizes of a scale.

mod evaluations;
mod trainings;

use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::{Map, Value};

use super::plan::StudyPlan;
use super::scale::StudyScale;

/// A model of the study: an entry of `study/paper.json`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyModel {
    /// The name in tables.
    pub name: String,
    /// Presets of the model, one for each scale: tiny, small, paper.
    presets: [String; 3],
    /// Fields of the model over its preset.
    #[serde(default)]
    model: Map<String, Value>,
    /// Fields of the training, merged over those of its scale.
    #[serde(default)]
    training: Map<String, Value>,
    /// Fields that replace `training` at scale paper.
    #[serde(default)]
    paper: Map<String, Value>,
    /// Optimizer steps, as a multiple of the scale's.
    #[serde(default = "one")]
    steps: u64,
    /// Number of trainings on each set. Each has robots of its own.
    #[serde(default = "three")]
    seeds: u64,
    /// The last set on which it is trained, beginning with D1.
    #[serde(default = "four")]
    sets: usize,
    /// Whether it gives several predictions, which are scored as a distribution.
    #[serde(default)]
    pub samples: bool,
    /// Whether it removes noise step by step, so that it can use fewer steps and warm starts.
    #[serde(default)]
    pub denoiser: bool,
    #[serde(default)]
    lengths: Lengths,
}

/// How a model takes part in the comparison of contexts and horizons.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Lengths {
    #[default]
    None,
    /// It is trained for each length.
    Trained,
    /// One training supports all lengths.
    Any,
}

const fn one() -> u64 {
    1
}
const fn three() -> u64 {
    3
}
const fn four() -> usize {
    4
}

/// The models of the study, in the order of every table.
///
/// # Panics
/// If the list cannot be read. A test checks that it can.
pub fn study_models() -> &'static [StudyModel] {
    static MODELS: LazyLock<Vec<StudyModel>> = LazyLock::new(|| {
        let text = include_str!("../../../study/paper.json");
        serde_json::from_str(text).unwrap_or_else(|error| panic!("study/paper.json: {error}"))
    });
    &MODELS
}

/// The study at a scale.
pub(super) fn plan(scale: StudyScale) -> StudyPlan {
    let trainings = trainings::all(scale);
    let evaluations = evaluations::all(scale, &trainings);
    StudyPlan { simulations: Vec::new(), trainings, evaluations }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::json;

    use super::*;
    use crate::study::StudyEdition;
    use crate::{DataSource, JobSpec, PipelineSpec, StudyScale, StudyTraining, parse};

    fn pipeline(scale: StudyScale) -> PipelineSpec {
        let text = json!({"preset": scale.preset()}).to_string();
        match parse(text.as_bytes()).unwrap_or_else(|error| panic!("{error}")) {
            JobSpec::Pipeline(pipeline) => pipeline,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_training_has_robots_of_its_own_which_no_evaluation_has() {
        for scale in StudyScale::ALL {
            let jobs = pipeline(scale).jobs;
            let seed = |data: &DataSource| match data {
                DataSource::Stream(stream) => stream.seed,
                other => panic!("{other:?}"),
            };
            let mut trained = BTreeSet::new();
            let mut asked = Vec::new();
            for member in jobs.values() {
                match &member.spec {
                    JobSpec::Train(spec) => trained.extend(spec.data.each().iter().map(seed)),
                    JobSpec::Evaluate(spec) => asked.push(seed(&spec.data)),
                    other => panic!("{other:?}"),
                }
            }
            assert!(asked.iter().all(|seed| !trained.contains(seed)), "{scale:?}");
        }
    }

    #[test]
    fn every_training_has_three_seeds_and_those_of_the_headline_five() {
        let plan = StudyPlan::of(StudyEdition::Paper, StudyScale::Small);
        for model in study_models() {
            let of_model: Vec<&StudyTraining> = plan
                .trainings
                .iter()
                .filter(|training| {
                    training.model == model.name && training.set == 1 && training.length.is_none()
                })
                .collect();
            assert!(of_model.len() >= 3, "{}", model.name);
        }
        let headline = |name: &str| {
            plan.trainings
                .iter()
                .filter(|training| training.model == name && training.set == 4)
                .count()
        };
        assert_eq!((headline("lagrangian"), headline("robomorph")), (5, 5));
    }

    #[test]
    fn every_evaluation_asks_trainings_of_its_own_set() {
        for scale in StudyScale::ALL {
            let plan = StudyPlan::of(StudyEdition::Paper, scale);
            for evaluation in &plan.evaluations {
                let asked = evaluation.spec["checkpoints"].as_array().unwrap();
                assert!(!asked.is_empty(), "{}", evaluation.job);
                for checkpoint in asked {
                    let job = checkpoint["job"].as_str().unwrap();
                    let training =
                        plan.trainings.iter().find(|training| training.job == job).unwrap();
                    assert_eq!(training.set, evaluation.set, "{}", evaluation.job);
                }
            }
        }
    }
}
