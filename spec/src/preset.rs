//! Named starting points: a preset's fields, with the user's own merged over them.

use serde::Serialize;
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use crate::SpecError;

/// A named starting point for a job or for a model.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Preset {
    pub name: String,
    /// What it is, in one line.
    pub about: String,
    pub place: PresetPlace,
    #[schema(value_type = Object)]
    pub spec: Value,
}

/// Where `"preset": NAME` may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PresetPlace {
    /// At the top of a job.
    Job,
    /// In a train job's `model`.
    Model,
}

/// Every preset, in the order to show them.
pub fn presets() -> Vec<Preset> {
    let mut all = vec![quickstart()];
    all.extend(datasets());
    all.extend([grid_chirp(), grid_multisine()]);
    all.extend(robomorph_sizes());
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

fn grid_chirp() -> Preset {
    let grid: Vec<f64> = (1..=10).map(|k| f64::from(k) / 10.0).collect();
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
    let grid = [0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5];
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

fn quickstart() -> Preset {
    Preset {
        name: "quickstart".to_owned(),
        about: "Simulate, train a tiny RoboMorph and evaluate it, in minutes".to_owned(),
        place: PresetPlace::Job,
        spec: json!({
            "kind": "pipeline",
            "name": "quickstart",
            "jobs": {
                "train-set": {"preset": "D1-multisine", "trajectories": 16_384, "shard_trajectories": 4096},
                "test-grid": {
                    "preset": "grid-multisine",
                    "trajectories": 700,
                    "excitation": {"multisine": {"frequency_hz": {
                        "grid": [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.45]
                    }}},
                },
                "train": {
                    "kind": "train",
                    "data": {"job": "train-set"},
                    "model": {"preset": "robomorph-tiny"},
                    "normalization": "dataset",
                    "optimizer": {
                        "learning_rate": 3e-3, "warmup_steps": 200, "gradient_clip_norm": 1.0
                    },
                    "batch_size": 32,
                    "steps": 3000,
                },
                "evaluate": {
                    "kind": "evaluate",
                    "data": {"job": "test-grid"},
                    "checkpoints": [{"job": "train"}],
                },
            },
        }),
    }
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
const REPLACED_WHOLE: [&str; 4] = ["frequency_hz", "data", "integrator", "checkpoints"];

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
