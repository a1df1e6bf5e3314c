//! Named starting points: a preset's fields, with the user's own merged over them.

use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use crate::SpecError;

mod study;

/// A named starting point for a job or for a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Preset {
    pub name: String,
    /// What it is, in one line.
    pub about: String,
    pub place: PresetPlace,
    #[schema(value_type = Object)]
    pub spec: Value,
}

/// Where `"preset": NAME` may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PresetPlace {
    /// At the top of a job.
    Job,
    /// In a train job's `model`.
    Model,
}

impl fmt::Display for PresetPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Job => "job",
            Self::Model => "model",
        })
    }
}

/// Every preset, in the order to show them.
pub fn presets() -> Vec<Preset> {
    let mut all = vec![quickstart(), four_models(), control()];
    all.extend(study::studies());
    all.extend(datasets());
    all.extend([grid_chirp(), grid_multisine()]);
    all.extend(robomorph_sizes());
    all.extend(diffuser_sizes());
    all.extend(cdcnn_sizes());
    all.extend(cdt_sizes());
    all.extend(flow_sizes());
    all
}

/// The paper's table of training sets: (name, chirp f in Hz, multisine f in Hz).
const DATASETS: [(&str, [f64; 2], [f64; 2]); 4] = [
    ("D1", [0.3, 0.3], [0.15, 0.15]),
    ("D2", [0.2, 0.4], [0.05, 0.15]),
    ("D3", [0.2, 0.6], [0.05, 0.25]),
    ("D4", [0.1, 0.7], [0.01, 0.30]),
];

fn datasets() -> impl Iterator<Item = Preset> {
    DATASETS.into_iter().flat_map(|(name, chirp, multisine)| {
        let chirp = json!({"frequency_hz": frequency(chirp)});
        let multisine = json!({"frequency_hz": frequency(multisine)});
        [
            ("chirp", json!({"chirp": chirp})),
            ("multisine", json!({"multisine": multisine})),
            ("mixed", json!({"chirp": chirp, "multisine": multisine})),
        ]
        .map(|(family, excitation)| Preset {
            name: format!("{name}-{family}"),
            about: format!("Simulate the paper's training set {name}, {family}, 3.5e5 robots"),
            place: PresetPlace::Job,
            spec: json!({
                "kind": "simulate",
                "trajectories": 350_000,
                "seed": 1,
                "excitation": excitation,
            }),
        })
    })
}

fn frequency([min, max]: [f64; 2]) -> Value {
    if min < max { json!({"uniform": [min, max]}) } else { json!({"fixed": min}) }
}

/// The frequencies of the test grids, Hz: of chirps, and of multisines.
pub(crate) fn test_grids() -> [Vec<f64>; 2] {
    let chirp = (1..=10).map(|k| f64::from(k) / 10.0).collect();
    [chirp, vec![0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5]]
}

fn grid_chirp() -> Preset {
    let [grid, _] = test_grids();
    Preset {
        name: "grid-chirp".to_owned(),
        about: "Simulate a test grid: chirp 0.1 to 1.0 Hz, 100 robots each".to_owned(),
        place: PresetPlace::Job,
        spec: json!({
            "kind": "simulate",
            "trajectories": 100 * grid.len(),
            "seed": 1_000_001,
            "excitation": {"chirp": {"frequency_hz": {"grid": grid}}},
        }),
    }
}

fn grid_multisine() -> Preset {
    let [_, grid] = test_grids();
    Preset {
        name: "grid-multisine".to_owned(),
        about: "Simulate a test grid: multisine 0.01 to 0.50 Hz, 100 robots each".to_owned(),
        place: PresetPlace::Job,
        spec: json!({
            "kind": "simulate",
            "trajectories": 100 * grid.len(),
            "seed": 1_000_002,
            "excitation": {"multisine": {"frequency_hz": {"grid": grid}}},
        }),
    }
}

fn robomorph_sizes() -> [Preset; 3] {
    let size =
        |name: &str, about: &str, d_model: u32, heads: u32, layers: u32, patch: u32| Preset {
            name: format!("robomorph-{name}"),
            about: format!("RoboMorph, {about}"),
            place: PresetPlace::Model,
            spec: json!({
                "architecture": "robomorph",
                "d_model": d_model,
                "heads": heads,
                "encoder_layers": layers,
                "decoder_layers": layers,
                "patch": patch,
            }),
        };
    [
        size("tiny", "minutes on two cores", 64, 4, 2, 10),
        size("small", "an hour on two cores", 128, 8, 3, 4),
        size("paper", "49.9 M parameters, the paper's size", 384, 8, 12, 1),
    ]
}

/// Below the paper's sizes: the clean series predicted, in few steps. Trained for long enough the
/// paper's choice does as well; trained for minutes it does not.
fn few_steps() -> (Value, Value) {
    (json!({"prediction": "x0"}), json!({"kind": "ddim", "steps": 5}))
}

/// The paper's T = 100, noise predicted, DDPM through every level.
fn as_published() -> (Value, Value) {
    (json!({"steps": 100, "prediction": "noise"}), json!({"kind": "ddpm", "steps": 100}))
}

fn model(name: &str, about: &str, mut spec: Value, (diffusion, sampler): (Value, Value)) -> Preset {
    spec["diffusion"] = diffusion;
    spec["sampler"] = sampler;
    Preset { name: name.to_owned(), about: about.to_owned(), place: PresetPlace::Model, spec }
}

fn diffuser_sizes() -> [Preset; 3] {
    let size = |width: u32, multipliers: [u32; 4]| json!({"architecture": "diffuser", "width": width, "multipliers": multipliers});
    [
        model(
            "diffuser-tiny",
            "Diffuser, minutes on two cores",
            size(16, [1, 2, 2, 4]),
            few_steps(),
        ),
        model(
            "diffuser-small",
            "Diffuser, an hour on two cores",
            size(48, [1, 2, 4, 4]),
            few_steps(),
        ),
        model(
            "diffuser-paper",
            "Diffuser, 63.1 M parameters, the paper's size",
            size(128, [1, 2, 4, 8]),
            as_published(),
        ),
    ]
}

fn cdcnn_sizes() -> [Preset; 3] {
    let size = |embedding: u32, widths: &[u32]| json!({"architecture": "cdcnn", "embedding": embedding, "widths": widths});
    [
        model(
            "cdcnn-tiny",
            "CDCNN, minutes on two cores",
            size(32, &[16, 32, 32, 64]),
            few_steps(),
        ),
        model(
            "cdcnn-small",
            "CDCNN, an hour on two cores",
            size(64, &[48, 96, 192, 192]),
            few_steps(),
        ),
        model(
            "cdcnn-paper",
            "CDCNN, 16.4 M parameters, the paper's size",
            size(128, &[128, 256, 512]),
            as_published(),
        ),
    ]
}

fn cdt_sizes() -> [Preset; 3] {
    let size = |d_model: u32, heads: u32, encoder_layers: u32, decoder_layers: u32| {
        json!({
            "architecture": "cdt",
            "d_model": d_model,
            "heads": heads,
            "encoder_layers": encoder_layers,
            "decoder_layers": decoder_layers,
        })
    };
    let mut paper = size(384, 8, 4, 12);
    paper["dropout"] = json!(0.1);
    paper["embedding_dropout"] = json!(0.1);
    [
        model("cdt-tiny", "CDT, minutes on two cores", size(48, 4, 1, 2), few_steps()),
        model("cdt-small", "CDT, an hour on two cores", size(128, 8, 2, 3), few_steps()),
        model("cdt-paper", "CDT, 35.8 M parameters, the paper's size", paper, as_published()),
    ]
}

/// CDCNN's U-Nets at each size.
fn flow_sizes() -> [Preset; 3] {
    let size = |name: &str, about: &str, embedding: u32, widths: &[u32]| Preset {
        name: format!("flow-{name}"),
        about: format!("Rectified flow over the damped integrator, {about}"),
        place: PresetPlace::Model,
        spec: json!({
            "architecture": "flow",
            "embedding": embedding,
            "widths": widths,
            "sampler": {"kind": "euler", "steps": 2},
            "residual": {"integrator": {"damping": 10.0}},
        }),
    };
    [
        size("tiny", "minutes on two cores", 32, &[16, 32, 32, 64]),
        size("small", "an hour on two cores", 64, &[48, 96, 192, 192]),
        size("paper", "16.4 M parameters, of the paper's CDCNN's size", 128, &[128, 256, 512]),
    ]
}

fn quickstart() -> Preset {
    let mut jobs = quickstart_data();
    jobs.insert("train".to_owned(), minutes_of_training("robomorph", 3e-3, 3000));
    jobs.insert("evaluate".to_owned(), comparison(&["train"]));
    Preset {
        name: "quickstart".to_owned(),
        about: "Simulate, train a tiny RoboMorph and evaluate it, in minutes".to_owned(),
        place: PresetPlace::Job,
        spec: json!({"kind": "pipeline", "name": "quickstart", "jobs": jobs}),
    }
}

/// On the quickstart's data, and with the quickstart's RoboMorph: what it did is not done again.
fn four_models() -> Preset {
    let mut jobs = quickstart_data();
    jobs.insert("robomorph".to_owned(), minutes_of_training("robomorph", 3e-3, 3000));
    jobs.insert("diffuser".to_owned(), minutes_of_training("diffuser", 2e-3, 3000));
    jobs.insert("cdcnn".to_owned(), minutes_of_training("cdcnn", 2e-3, 3000));
    jobs.insert("cdt".to_owned(), minutes_of_training("cdt", 2e-3, 1500));
    jobs.insert("evaluate".to_owned(), comparison(&["robomorph", "diffuser", "cdcnn", "cdt"]));
    Preset {
        name: "four-models".to_owned(),
        about: "Train four architectures, tiny, on one training set and compare them, in about 11 \
                minutes on two cores"
            .to_owned(),
        place: PresetPlace::Job,
        spec: json!({"kind": "pipeline", "name": "four-models", "jobs": jobs}),
    }
}

/// With two of the four models, which are found if they were trained before.
fn control() -> Preset {
    let (train_set, data) = ("train-set", quickstart_data());
    let mut jobs = Map::from_iter([(train_set.to_owned(), data[train_set].clone())]);
    jobs.insert("robomorph".to_owned(), minutes_of_training("robomorph", 3e-3, 3000));
    jobs.insert("cdt".to_owned(), minutes_of_training("cdt", 2e-3, 1500));
    let robots = json!({"preset": "D1-multisine", "trajectories": 8, "seed": 2_000_001});
    let mut closed_loop = json!({
        "kind": "control",
        "data": {"stream": robots},
        "checkpoints": [{"job": "robomorph"}, {"job": "cdt"}],
    });
    jobs.insert("control".to_owned(), closed_loop.clone());
    // One of them is enough to see what becomes of models there.
    closed_loop["checkpoints"] = json!([{"job": "robomorph"}]);
    closed_loop["path"] = json!({"swing": {
        "amplitude_rad": [0.8, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8],
        "frequency_hz": [0.3, 0.4, 0.5, 0.3, 0.4, 0.4, 0.4],
    }});
    jobs.insert("control-fast".to_owned(), closed_loop);
    Preset {
        name: "control".to_owned(),
        about: "Move robots along a path by model predictive control through two trained models, \
                slowly and faster than they have seen"
            .to_owned(),
        place: PresetPlace::Job,
        spec: json!({"kind": "pipeline", "name": "control", "jobs": jobs}),
    }
}

/// Robots under multisines of one frequency, and a grid of frequencies around it.
fn quickstart_data() -> Map<String, Value> {
    let grid = [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.45];
    let train_set = json!({
        "preset": "D1-multisine", "trajectories": 16_384, "shard_trajectories": 4096,
    });
    let test_grid = json!({
        "preset": "grid-multisine",
        "trajectories": 700,
        "excitation": {"multisine": {"frequency_hz": {"grid": grid}}},
    });
    Map::from_iter([("train-set".to_owned(), train_set), ("test-grid".to_owned(), test_grid)])
}

fn minutes_of_training(architecture: &str, learning_rate: f64, steps: u64) -> Value {
    json!({
        "kind": "train",
        "data": {"job": "train-set"},
        "model": {"preset": format!("{architecture}-tiny")},
        "normalization": "dataset",
        "optimizer": {
            "learning_rate": learning_rate, "warmup_steps": 200, "gradient_clip_norm": 1.0
        },
        "batch_size": 32,
        "steps": steps,
    })
}

fn comparison(trainings: &[&str]) -> Value {
    let checkpoints: Vec<Value> = trainings.iter().map(|job| json!({"job": job})).collect();
    json!({"kind": "evaluate", "data": {"job": "test-grid"}, "checkpoints": checkpoints})
}

/// Replaces `"preset"` at the top of a job by that preset with the other fields merged over it.
pub(crate) fn resolve_job(fields: Map<String, Value>) -> Result<Map<String, Value>, SpecError> {
    resolve(fields, PresetPlace::Job)
}

/// Does the same in a train job's `model`.
pub(crate) fn resolve_model(
    mut fields: Map<String, Value>,
) -> Result<Map<String, Value>, SpecError> {
    if let Some(Value::Object(model)) = fields.get_mut("model") {
        let resolved = resolve(std::mem::take(model), PresetPlace::Model)
            .map_err(|error| error.within("model"))?;
        *model = resolved;
    }
    Ok(fields)
}

fn resolve(
    mut fields: Map<String, Value>,
    place: PresetPlace,
) -> Result<Map<String, Value>, SpecError> {
    let Some(name) = fields.remove("preset") else { return Ok(fields) };
    let candidates: Vec<Preset> =
        presets().into_iter().filter(|preset| preset.place == place).collect();
    let Some(preset) = candidates.iter().find(|preset| name == preset.name.as_str()) else {
        let names: Vec<&str> = candidates.iter().map(|preset| preset.name.as_str()).collect();
        return Err(SpecError::one("preset", name.to_string(), names.join(", ")));
    };
    let mut merged = preset.spec.clone();
    merge(&mut merged, Value::Object(fields));
    match merged {
        Value::Object(fields) => Ok(fields),
        other => Err(SpecError::one("preset", other.to_string(), "a preset that is an object")),
    }
}

/// Fields that hold one of several choices: merging would mix two of them.
const REPLACED_WHOLE: [&str; 5] = ["frequency_hz", "data", "integrator", "checkpoints", "path"];

/// Merges objects field by field; everything else, `null` included, replaces.
fn merge(base: &mut Value, over: Value) {
    match (base, over) {
        (Value::Object(base), Value::Object(over)) => {
            for (key, value) in over {
                match base.get_mut(&key) {
                    Some(slot) if !REPLACED_WHOLE.contains(&key.as_str()) => merge(slot, value),
                    _ => {
                        base.insert(key, value);
                    }
                }
            }
        }
        (base, over) => *base = over,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{JobSpec, parse};

    #[test]
    fn every_job_preset_is_a_valid_job() {
        for preset in presets().into_iter().filter(|preset| preset.place == PresetPlace::Job) {
            let text = json!({"preset": preset.name}).to_string();
            parse(text.as_bytes()).unwrap_or_else(|error| panic!("{}: {error}", preset.name));
        }
    }

    #[test]
    fn every_model_preset_is_a_valid_model() {
        for preset in presets().into_iter().filter(|preset| preset.place == PresetPlace::Model) {
            let text = json!({
                "kind": "train",
                "data": {"dataset": 1},
                "model": {"preset": preset.name},
                "steps": 1,
            });
            parse(text.to_string().as_bytes())
                .unwrap_or_else(|error| panic!("{}: {error}", preset.name));
        }
    }

    #[test]
    fn pipelines_find_what_others_did() {
        let job = |preset: &str, name: &str| {
            let JobSpec::Pipeline(pipeline) =
                parse(json!({"preset": preset}).to_string().as_bytes()).unwrap()
            else {
                panic!("not a pipeline");
            };
            pipeline.jobs[name].spec.to_json()
        };
        for name in ["train-set", "test-grid"] {
            assert_eq!(job("four-models", name), job("quickstart", name));
        }
        assert_eq!(job("four-models", "robomorph"), job("quickstart", "train"));
        for name in ["train-set", "robomorph", "cdt"] {
            assert_eq!(job("control", name), job("four-models", name));
        }
    }

    #[test]
    fn fields_beside_a_preset_are_merged_over_it() {
        let text = json!({
            "preset": "quickstart",
            "jobs": {
                "train-set": {"excitation": {"multisine": {"frequency_hz": {"uniform": [0.1, 0.2]}}}},
                "train": {"steps": 10, "optimizer": {"warmup_steps": 0}, "model": {"heads": 2}},
            },
        });
        let JobSpec::Pipeline(pipeline) = parse(text.to_string().as_bytes()).unwrap() else {
            panic!("not a pipeline");
        };
        let JobSpec::Train(train) = &pipeline.jobs["train"].spec else { panic!("not a training") };
        assert_eq!((train.steps, train.optimizer.warmup_steps), (10, 0));
        assert_eq!(train.optimizer.learning_rate, 3e-3);
        assert_eq!(pipeline.jobs["train-set"].spec.to_json()["trajectories"], 16_384);
    }
}
