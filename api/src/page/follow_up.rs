//! Jobs that go on from what the server has: the form opens with their specs.

use serde_json::{Value, json};
use spec::{DataSpec, Gravity, JobSpec};
use wire::{Checkpoint, Dataset, DatasetState, Listed as _};

use crate::access::may_submit;
use crate::app::App;
use crate::app::listing::ListRequest;
use crate::error::ApiError;
use crate::page::parts::Link;

/// A job that goes on from a thing of the server.
#[derive(Clone, Copy)]
struct FollowUp {
    /// The kind of the thing, and the word for the job in addresses.
    of: &'static str,
    word: &'static str,
    /// The words of its link.
    words: &'static str,
}

const ALL: [FollowUp; 6] = [
    FollowUp { of: "dataset", word: "train", words: "Train on it" },
    FollowUp { of: "dataset", word: "evaluate", words: "Evaluate on it" },
    FollowUp { of: "dataset", word: "identify", words: "Identify its arm" },
    FollowUp { of: "checkpoint", word: "evaluate", words: "Evaluate it" },
    FollowUp { of: "checkpoint", word: "fine-tune", words: "Fine-tune it" },
    FollowUp { of: "robot", word: "simulate", words: "Simulate arms like it" },
];

/// The baselines of an evaluation to begin with.
const BASELINES: [&str; 5] =
    ["hold-last", "constant-velocity", "arx", "nominal-simulator", "identification"];

/// The links of a dataset that is complete.
pub fn of_dataset(dataset: &Dataset) -> Vec<Link> {
    links("dataset", dataset.id, |word| word != "identify" || shows_an_arm(dataset))
}

/// Whether its torques are those of one arm, with its weight. Others identify nothing. In a simulation
/// each trajectory has an arm of its own.
fn shows_an_arm(dataset: &Dataset) -> bool {
    data_spec(&dataset.spec).is_some_and(|data| match data {
        DataSpec::Simulation(spec) => {
            spec.robot.gravity == Gravity::On && dataset.trajectories == 1
        }
        DataSpec::Import(spec) => spec.robot().gravity == Gravity::On,
    })
}

/// A job of a kind to begin with, and what it does.
pub struct Start {
    pub link: Link,
    pub about: String,
}

impl Start {
    fn new(href: impl Into<String>, words: &str, about: impl Into<String>) -> Self {
        Self { link: Link::new(href, words), about: about.into() }
    }

    fn from(from: &str, words: &str, about: impl Into<String>) -> Self {
        Self::new(format!("/launch?from={from}"), words, about)
    }
}

/// Datasets that are looked at for one that a job could read.
const NEWEST: usize = 50;

/// A job of each kind, with the newest things that it could read.
///
/// # Errors
/// When the database fails.
pub async fn starts(app: &App) -> Result<Vec<Start>, ApiError> {
    let newest = [("limit".to_owned(), NEWEST.to_string())];
    let mut datasets =
        app.list::<Dataset>(&ListRequest::read(&Dataset::LIST, &newest)?).await?.datasets;
    datasets.retain(|dataset| dataset.state == DatasetState::Complete && dataset.trajectories > 0);
    let newest = [("limit".to_owned(), "1".to_owned())];
    let checkpoints =
        app.list::<Checkpoint>(&ListRequest::read(&Checkpoint::LIST, &newest)?).await?.checkpoints;
    let called = |dataset: &Dataset| format!("dataset {}, {}", dataset.id, dataset.name);
    let train = match datasets.first() {
        Some(dataset) => Start::from(
            &format!("dataset:{}:train", dataset.id),
            "Train",
            format!("A model learns from {}, or from another dataset.", called(dataset)),
        ),
        None => Start::from("new:train", "Train", "A model learns from arms simulated on the way."),
    };
    let evaluate = match (checkpoints.first(), datasets.first()) {
        (Some(Checkpoint { id, architecture, .. }), _) => Start::from(
            &format!("checkpoint:{id}:evaluate"),
            "Evaluate",
            format!("Checkpoint {id}, {architecture}, or others, beside the baselines."),
        ),
        (None, Some(dataset)) => Start::from(
            &format!("dataset:{}:evaluate", dataset.id),
            "Evaluate",
            format!("The baselines on {}.", called(dataset)),
        ),
        (None, None) => Start::from("new:evaluate", "Evaluate", "The baselines on simulated arms."),
    };
    let identify = match datasets.iter().find(|dataset| shows_an_arm(dataset)) {
        Some(dataset) => Start::from(
            &format!("dataset:{}:identify", dataset.id),
            "Identify",
            format!("Masses, inertias and friction of the arm of {}.", called(dataset)),
        ),
        None => Start::new(
            "/upload",
            "Identify",
            "Masses, inertias and friction of an arm. It needs recordings: upload them first.",
        ),
    };
    Ok(vec![
        Start::from("new:simulate", "Simulate", "Arms in motion become a dataset."),
        train,
        evaluate,
        identify,
        Start::from(
            "new:control",
            "Control",
            "Controllers, and checkpoints if you add some, move simulated arms along a path.",
        ),
        Start::new("/upload", "Import", "Recordings of your own arm become a dataset."),
        Start::new("/upload#robot", "Add an arm", "A URDF becomes a robot that specs can name."),
    ])
}

/// The spec of a job that reads nothing of the server, and what it is in words.
fn of_kind(kind: &str) -> Option<(String, Value)> {
    let simulated = json!({"preset": "panda-real", "trajectories": 100, "seed": 1_000_003});
    let weightless = json!({"preset": "D1-multisine", "trajectories": 8, "seed": 2_000_001});
    let (about, spec) = match kind {
        "simulate" => (
            "A simulation of Pandas as they are used.",
            json!({"preset": "panda-real", "trajectories": 2048}),
        ),
        "train" => (
            "A training on simulated Pandas.",
            training(&json!({"stream": {"preset": "panda-real"}}), Some(&json!("panda"))),
        ),
        "evaluate" => (
            "The baselines on simulated Pandas.",
            json!({"kind": "evaluate", "data": {"stream": simulated}, "baselines": BASELINES}),
        ),
        "control" => (
            "The controllers of Pandas without gravity.",
            json!({"kind": "control", "data": {"stream": weightless}}),
        ),
        _ => return None,
    };
    Some((about.to_owned(), spec))
}

/// The links of a checkpoint.
pub fn of_checkpoint(id: i64) -> Vec<Link> {
    links("checkpoint", id, |_| true)
}

/// The links of a robot.
pub fn of_robot(id: i64) -> Vec<Link> {
    links("robot", id, |_| true)
}

fn links(of: &str, id: i64, is_possible: impl Fn(&str) -> bool) -> Vec<Link> {
    if !may_submit() {
        return Vec::new();
    }
    let possible = ALL.iter().filter(|it| it.of == of && is_possible(it.word));
    let link = |it: &FollowUp| Link::new(format!("/launch?from={of}:{id}:{}", it.word), it.words);
    possible.map(link).collect()
}

/// The spec that a form begins with, and what it is in words. `from` is the end of an address, such
/// as `dataset:3:train`. `None` if it names nothing.
///
/// # Errors
/// When the thing does not exist.
pub async fn beginning(app: &App, from: &str) -> Result<Option<(String, Value)>, ApiError> {
    if let Some(kind) = from.strip_prefix("new:") {
        return Ok(of_kind(kind));
    }
    let mut parts = from.splitn(3, ':');
    let (Some(of), Some(id), Some(word)) = (parts.next(), parts.next(), parts.next()) else {
        return Ok(None);
    };
    let known = ALL.iter().find(|it| it.of == of && it.word == word);
    let (Some(known), Ok(id)) = (known, id.parse::<i64>()) else { return Ok(None) };
    let (name, spec) = match of {
        "dataset" => {
            let dataset = app.dataset(id).await?;
            (dataset.name.clone(), on_dataset(&dataset, word))
        }
        "checkpoint" => {
            let checkpoint = app.checkpoint(id).await?;
            let training = app.job(checkpoint.job).await?;
            let data = match app.dataset_of_training(&checkpoint).await? {
                Some(dataset) => Some(app.dataset(dataset).await?),
                None => None,
            };
            let spec = match word {
                "fine-tune" => fine_tuning(id, training.spec),
                _ => evaluation(id, &training.spec, data.as_ref()),
            };
            (training.name, spec)
        }
        _ => (app.kept_robot(id).await?.name, simulation(id)),
    };
    Ok(Some((format!("{of} {id}, {name}: {}.", known.words.to_lowercase()), spec)))
}

fn data_spec(spec: &Value) -> Option<DataSpec> {
    let job: JobSpec = serde_json::from_value(spec.clone()).ok()?;
    DataSpec::of(&job)
}

/// A job that reads a dataset.
fn on_dataset(dataset: &Dataset, word: &str) -> Value {
    let data = json!({"dataset": dataset.id});
    // As in the presets, a fifth of each trajectory is predicted.
    let context = dataset.samples - (dataset.samples / 5).max(1);
    match word {
        "identify" => json!({"kind": "identify", "data": data}),
        "evaluate" => json!({
            "kind": "evaluate", "data": data, "context": context, "baselines": BASELINES,
        }),
        _ => {
            let mut training = training(&data, dataset.spec.pointer("/robot/model"));
            training["context"] = json!(context);
            training
        }
    }
}

/// A short training of the model that needs the least data.
fn training(data: &Value, robot: Option<&Value>) -> Value {
    let mut model = json!({"architecture": "lagrangian", "points": 100, "rotor_inertia": true});
    // Equations that are told the arm need less data.
    if let Some(robot) = robot {
        model["robot"] = json!({"model": robot});
    }
    json!({
        "kind": "train", "data": data, "model": model,
        "optimizer": {
            "learning_rate": 0.005, "warmup_steps": 30, "betas": [0.9, 0.99],
            "final_learning_rate_ratio": 0.001,
        },
        "batch_size": 8, "steps": 360, "validate_every_steps": 180,
    })
}

/// The training of a checkpoint again, from its weights on.
fn fine_tuning(checkpoint: i64, mut training: Value) -> Value {
    training["init"] = json!({"checkpoint": checkpoint});
    training
}

/// The evaluation of a checkpoint on other robots of the law that its training's robots had, or on
/// the recordings that it was trained on.
fn evaluation(checkpoint: i64, training: &Value, data: Option<&Dataset>) -> Value {
    let stream = match data {
        Some(dataset) if dataset.spec["kind"] == "simulate" => Some(dataset.spec.clone()),
        _ => training.pointer("/data/stream").cloned(),
    };
    let data = match (stream, data) {
        (Some(mut stream), _) => {
            stream["seed"] = json!(1_000_003);
            stream["trajectories"] = json!(100);
            json!({"stream": stream})
        }
        (None, Some(dataset)) => json!({"dataset": dataset.id}),
        (None, None) => training["data"].clone(),
    };
    json!({
        "kind": "evaluate", "data": data, "context": training["context"],
        "checkpoints": [{"checkpoint": checkpoint}],
    })
}

/// Arms around a robot, as they are used.
fn simulation(robot: i64) -> Value {
    json!({
        "kind": "simulate",
        "robot": {
            "model": {"robot": robot}, "gravity": "on",
            "mass_fraction": 0.2, "com_fraction": 0.1, "inertia_fraction": 0.15,
            "damping_fraction": 0.5, "armature_fraction": 0.3,
        },
        "excitation": {"via_points": {"frequency_hz": {"uniform": [0.3, 1.0]}, "speed": [0.1, 0.6]}},
        "controller": {"law": {"computed-torque": {"natural_frequency_hz": [2, 4]}}},
        "trajectories": 2048, "samples": 400,
    })
}
