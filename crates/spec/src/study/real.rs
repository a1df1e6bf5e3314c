//! The study of arms as they are used, third edition. It is a pipeline made from the lists of arms,
//! models and questions in `study/real.json`.

use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::plan::{StudyEvaluation, StudyPlan, StudyQuestion, StudyTraining, checkpoints};
use super::scale::StudyScale;
use crate::merge::merge;

/// Seed of the robots of trainings with seed 0. That of an evaluation follows [`ASKED`].
const TRAINED: u64 = 100;

/// Seed of the robots in evaluations, beyond all seeds of trainings.
const ASKED: u64 = 1_000_100;

/// How much smaller `tiny` is than `small`, in steps and robots.
const TINY: u64 = 25;

/// The lists of the study.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RealStudy {
    /// The arms.
    pub arms: Vec<StudyArm>,
    models: Vec<Model>,
    trainings: Vec<Training>,
    baselines: Vec<String>,
    /// The questions about simulated arms, in the order of the report.
    pub questions: Vec<Question>,
    /// The questions about recordings of real arms.
    pub recordings: Vec<StudyRecording>,
}

/// An arm of the study.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyArm {
    /// Its name in jobs.
    pub name: String,
    /// The simulation of its robots.
    robots: Map<String, Value>,
    /// The number of samples that predictors observe.
    context: u32,
    /// The import of its recordings, without `kind` and `file`.
    pub import: Value,
}

/// A model that is trained.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Model {
    name: String,
    arm: String,
    /// Number of trainings. Each has robots of its own.
    #[serde(default = "three")]
    seeds: u64,
    /// The entry of `trainings` that it is trained by.
    training: String,
    model: Value,
    /// Fields over those of the entry's own robots.
    #[serde(default)]
    robots: Map<String, Value>,
    /// Fields over those of the entry.
    #[serde(default)]
    fields: Map<String, Value>,
}

const fn three() -> u64 {
    3
}

/// A way of training.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Training {
    name: String,
    /// Fields of the simulation, for models whose robots are drawn step by step. Others share the
    /// simulated arms of their seed.
    #[serde(default)]
    own_robots: Option<Map<String, Value>>,
    fields: Map<String, Value>,
}

/// A question about simulated arms.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Question {
    /// Its name in jobs.
    pub name: String,
    /// How its robots differ from those of the trainings, in tables.
    pub title: String,
    arm: String,
    /// Fields of the simulation over those of the arm.
    robots: Map<String, Value>,
    /// Number of scenarios at `small`.
    #[serde(default = "hundred")]
    scenarios: u64,
    #[serde(default)]
    context: Option<u32>,
    #[serde(default)]
    samples: Option<u32>,
    /// The models that it asks; all of its arm if missing.
    #[serde(default)]
    models: Option<Vec<String>>,
    #[serde(default)]
    latency: bool,
}

const fn hundred() -> u64 {
    100
}

/// A recording of a real arm. It is no part of torqued.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyRecording {
    /// Its name in jobs.
    pub name: String,
    /// Its name in tables.
    pub title: String,
    arm: String,
    /// The path of its file in the folder of recordings.
    pub file: String,
}

impl RealStudy {
    /// The title in tables of a question or of a recording; empty if there is none of that name.
    pub fn title(&self, name: &str) -> &str {
        let questions = self.questions.iter().map(|question| (&question.name, &question.title));
        let recordings =
            self.recordings.iter().map(|recording| (&recording.name, &recording.title));
        questions.chain(recordings).find(|(found, _)| *found == name).map_or("", |(_, title)| title)
    }
}

impl StudyRecording {
    /// The import of its file, without `kind` and `file`.
    pub fn import(&self) -> &'static Value {
        &arm(&self.arm).1.import
    }
}

/// The lists of the study of arms as they are used.
///
/// # Panics
/// If they cannot be read. A test checks that they can.
pub fn real_study() -> &'static RealStudy {
    static STUDY: LazyLock<RealStudy> = LazyLock::new(|| {
        let text = include_str!("../../study/real.json");
        serde_json::from_str(text).unwrap_or_else(|error| panic!("study/real.json: {error}"))
    });
    &STUDY
}

pub(super) const fn about(scale: StudyScale) -> &'static str {
    scale.pick([
        "The study of arms as they are used in minutes: every kind of its jobs, too small to conclude from",
        "The study of arms as they are used: light damping, friction, unknown loads, a controller",
        "The study of arms as they are used",
    ])
}

/// The number of an arm, from 1, and the arm with this name.
fn arm(name: &str) -> (usize, &'static StudyArm) {
    let mut arms = (1..).zip(&real_study().arms);
    arms.find(|(_, arm)| arm.name == name)
        .unwrap_or_else(|| panic!("study/real.json: no arm {name:?}"))
}

/// The name of the arm with this number, from 1.
pub(super) fn arm_of_set(set: usize) -> &'static str {
    real_study().arms.get(set.wrapping_sub(1)).map_or("", |arm| &arm.name)
}

/// The study at a scale.
pub(super) fn plan(scale: StudyScale) -> StudyPlan {
    let mut simulations = Vec::new();
    let mut trainings = Vec::new();
    for model in &real_study().models {
        for seed in 1..=scale.pick([2, model.seeds, model.seeds]) {
            let training = training(scale, model, seed, &mut simulations);
            trainings.push(training);
        }
    }
    let questions = real_study().questions.iter().enumerate();
    let ask = |(k, question)| evaluation(scale, k as u64, question, &trainings);
    let evaluations = questions.map(ask).collect();
    StudyPlan { simulations, trainings, evaluations }
}

/// A number of `small`, at another scale.
fn scaled(scale: StudyScale, number: u64) -> u64 {
    scale.pick([number.div_ceil(TINY), number, number])
}

fn training(
    scale: StudyScale,
    model: &Model,
    seed: u64,
    simulations: &mut Vec<(String, Value)>,
) -> StudyTraining {
    let (set, arm) = arm(&model.arm);
    let way = real_study().trainings.iter().find(|way| way.name == model.training);
    let way = way.unwrap_or_else(|| panic!("study/real.json: no training {:?}", model.training));
    let mut robots = Value::Object(arm.robots.clone());
    robots["seed"] = json!(TRAINED + seed);
    let data = match &way.own_robots {
        Some(own) => {
            merge(&mut robots, Value::Object(own.clone()));
            merge(&mut robots, Value::Object(model.robots.clone()));
            json!({"stream": robots})
        }
        None => {
            let name = format!("{}-arms-{seed}", arm.name);
            robots["kind"] = json!("simulate");
            robots["trajectories"] = json!(scale.pick([512, 16384, 16384]));
            robots["shard_trajectories"] = json!(4096);
            if simulations.iter().all(|(simulation, _)| *simulation != name) {
                simulations.push((name.clone(), robots));
            }
            json!({"job": name})
        }
    };
    let mut spec = json!({
        "kind": "train",
        "data": data,
        "model": model.model,
        "context": arm.context,
        "checkpoint_every_steps": null,
        "seed": seed,
    });
    merge(&mut spec, Value::Object(way.fields.clone()));
    merge(&mut spec, Value::Object(model.fields.clone()));
    let numbers = |value: &Value| value.as_u64().unwrap_or(0);
    let steps = scaled(scale, numbers(&spec["steps"]));
    spec["optimizer"]["warmup_steps"] =
        json!(scaled(scale, numbers(&spec["optimizer"]["warmup_steps"])));
    spec["steps"] = json!(steps);
    spec["validate_every_steps"] = json!(steps);
    StudyTraining {
        job: format!("{}-{}-{seed}", arm.name, model.name),
        model: model.name.clone(),
        set,
        seed,
        length: None,
        spec,
    }
}

/// The trainings on an arm of the `wanted` models.
fn of_arm<'a>(
    trainings: &'a [StudyTraining],
    set: usize,
    wanted: Option<&'a [String]>,
) -> impl Iterator<Item = &'a StudyTraining> {
    trainings.iter().filter(move |training| {
        training.set == set && wanted.is_none_or(|wanted| wanted.contains(&training.model))
    })
}

fn evaluation(
    scale: StudyScale,
    number: u64,
    question: &'static Question,
    trainings: &[StudyTraining],
) -> StudyEvaluation {
    let (set, arm) = arm(&question.arm);
    let mut robots = Value::Object(arm.robots.clone());
    merge(&mut robots, Value::Object(question.robots.clone()));
    robots["seed"] = json!(ASKED + number);
    robots["trajectories"] = json!(scaled(scale, question.scenarios));
    let mut spec = json!({
        "kind": "evaluate",
        "data": {"stream": robots},
        "context": question.context.unwrap_or(arm.context),
        "checkpoints": checkpoints(of_arm(trainings, set, question.models.as_deref())),
        "baselines": real_study().baselines,
    });
    if let Some(samples) = question.samples {
        spec["samples"] = json!(samples);
    }
    if question.latency {
        spec["latency"] = json!({"repeats": scale.pick([20, 50, 50])});
    }
    let job = format!("{}-{}", arm.name, question.name);
    StudyEvaluation { job, question: StudyQuestion::Arms(&question.name), set, spec }
}

/// The evaluation of all trainings on an arm on a recording of it, which is the dataset `dataset`.
pub(super) fn on_recording(
    recording: &'static StudyRecording,
    dataset: i64,
    trainings: &[StudyTraining],
) -> StudyEvaluation {
    let (set, arm) = arm(&recording.arm);
    let baselines = real_study().baselines.iter().filter(|name| *name != "oracle");
    let spec = json!({
        "kind": "evaluate",
        "data": {"dataset": dataset},
        "context": arm.context,
        "checkpoints": checkpoints(of_arm(trainings, set, None)),
        "baselines": baselines.collect::<Vec<_>>(),
    });
    let question = StudyQuestion::Arms(&recording.name);
    StudyEvaluation { job: recording.name.clone(), question, set, spec }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::{DataSource, JobSpec, PipelineSpec, StudyEdition, parse};

    fn pipeline(scale: StudyScale) -> PipelineSpec {
        let name = StudyEdition::Real.preset(scale).unwrap();
        let text = json!({"preset": name}).to_string();
        match parse(text.as_bytes()).unwrap_or_else(|error| panic!("{error}")) {
            JobSpec::Pipeline(pipeline) => pipeline,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn no_evaluation_has_robots_of_a_training_or_of_another_one() {
        for scale in [StudyScale::Tiny, StudyScale::Small] {
            let (mut trained, mut asked) = (BTreeSet::new(), Vec::new());
            for member in pipeline(scale).jobs.values() {
                match &member.spec {
                    JobSpec::Simulate(spec) => drop(trained.insert(spec.seed)),
                    JobSpec::Train(spec) => {
                        for source in spec.data.each() {
                            if let DataSource::Stream(stream) = source {
                                trained.insert(stream.seed);
                            }
                        }
                    }
                    JobSpec::Evaluate(spec) => match &spec.data {
                        DataSource::Stream(stream) => asked.push(stream.seed),
                        other => panic!("{other:?}"),
                    },
                    other => panic!("{other:?}"),
                }
            }
            assert!(asked.iter().all(|seed| !trained.contains(seed)), "{scale:?}");
            let distinct: BTreeSet<u64> = asked.iter().copied().collect();
            assert_eq!(distinct.len(), asked.len(), "{scale:?}");
        }
    }

    #[test]
    fn the_headline_has_five_trainings_and_every_model_three() {
        let plan = plan(StudyScale::Small);
        for model in &real_study().models {
            let (set, _) = arm(&model.arm);
            let of_model =
                |training: &&StudyTraining| training.set == set && training.model == model.name;
            let seeds = plan.trainings.iter().filter(of_model).count() as u64;
            assert!(seeds == model.seeds && seeds >= 3, "{}", model.name);
        }
        let usual = &plan.evaluations[0].spec["checkpoints"];
        let asked = usual.as_array().unwrap();
        let count = |name: &str| {
            let begins = |it: &&Value| it["job"].as_str().unwrap().starts_with(name);
            asked.iter().filter(begins).count()
        };
        assert_eq!((count("panda-law-1"), count("panda-law-5")), (1, 1));
        assert_eq!(count("panda-robomorph"), 3);
        assert_eq!(count("ur10e"), 0);
    }

    #[test]
    fn recordings_are_asked_of_the_models_of_their_arm() {
        let mut plan = StudyPlan::of(StudyEdition::Real, StudyScale::Tiny);
        for recording in &real_study().recordings {
            let mut import = recording.import().clone();
            merge(&mut import, json!({"kind": "import", "file": "0".repeat(64)}));
            parse(import.to_string().as_bytes()).unwrap_or_else(|error| panic!("{error}"));
            plan.add_recording(recording, 7);
        }
        let pipeline = plan.pipeline("real").to_string();
        parse(pipeline.as_bytes()).unwrap_or_else(|error| panic!("{error}"));
        let last = plan.evaluations.last().unwrap();
        assert_eq!(last.spec["data"], json!({"dataset": 7}));
        let checkpoints = last.spec["checkpoints"].as_array().unwrap();
        assert!(checkpoints.iter().all(|it| it["job"].as_str().unwrap().starts_with("ur10e-")));
    }
}
