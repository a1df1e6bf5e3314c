//! Presets: named starting points. The user's fields are merged over a preset's fields.

use std::fmt;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use crate::merge::merge;
use crate::schema::{listed, nearest};
use crate::shorten::shorten;
use crate::{JobKind, SpecError, Violation, study};

/// Name and text of each file in the folder `presets`, sorted.
static FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/presets.rs"));

/// A named starting point for a job or for a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Preset {
    /// The name in `"preset": NAME`.
    pub name: String,
    /// A description in one line.
    pub about: String,
    /// Where it may be used.
    pub place: PresetPlace,
    /// Its fields, which those of the user are merged over.
    #[schema(value_type = Object)]
    pub spec: Value,
}

/// The places where `"preset": NAME` may be written.
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

/// All presets in the order in which they are shown: the files, and the study, which is made from
/// its list of models.
///
/// # Panics
/// If a file of the folder `presets` is invalid. A test checks that none is.
pub fn presets() -> &'static [Preset] {
    static PRESETS: LazyLock<Vec<Preset>> = LazyLock::new(|| {
        let read = |(file, text): &(&str, &str)| {
            serde_json::from_str(text).unwrap_or_else(|error| panic!("{file}: {error}"))
        };
        let files = FILES.iter().map(|file| (file.0.to_owned(), read(file)));
        let mut all: Vec<(String, Preset)> = files.chain(study::presets()).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        all.into_iter().map(|(_, preset)| preset).collect()
    });
    &PRESETS
}

/// Replaces `"preset"` at the top of a job by the preset's fields, with the other fields merged
/// over them.
pub(crate) fn resolve_job(fields: Map<String, Value>) -> Result<Map<String, Value>, SpecError> {
    resolve(fields, PresetPlace::Job)
}

/// Does the same in a train job's `model`.
pub(crate) fn resolve_model(
    mut fields: Map<String, Value>,
    found: &mut SpecError,
) -> Map<String, Value> {
    match fields.get_mut("model") {
        Some(Value::Object(model)) => match resolve(std::mem::take(model), PresetPlace::Model) {
            Ok(resolved) => *model = resolved,
            Err(error) => found.append(error.within("model")),
        },
        Some(Value::String(name)) => {
            found.add_with(|| text_for_object("model", name, &presets_of(PresetPlace::Model)));
        }
        _ => {}
    }
    fields
}

/// The presets that may be used in this place.
pub(crate) fn presets_of(place: PresetPlace) -> Vec<&'static Preset> {
    presets().iter().filter(|preset| preset.place == place).collect()
}

/// The presets of jobs of this kind.
pub(crate) fn presets_of_kind(kind: JobKind) -> Vec<&'static Preset> {
    let is_of_kind = |preset: &&Preset| preset.spec["kind"] == kind.as_str();
    presets_of(PresetPlace::Job).into_iter().filter(is_of_kind).collect()
}

/// The violation of a text in place of an object. The text may be the name of a preset.
pub(crate) fn text_for_object(field: &str, text: &str, candidates: &[&Preset]) -> Violation {
    let names: Vec<&str> = candidates.iter().map(|preset| preset.name.as_str()).collect();
    let allowed = match nearest(text, names.iter().copied()) {
        Some(meant) => format!("an object; did you mean {{\"preset\": \"{meant}\"}}?"),
        None => format!("an object, or {{\"preset\": NAME}} with one of {}", names.join(", ")),
    };
    Violation::new(field, shorten(&text.into()), allowed)
}

fn resolve(
    mut fields: Map<String, Value>,
    place: PresetPlace,
) -> Result<Map<String, Value>, SpecError> {
    let Some(name) = fields.remove("preset") else { return Ok(fields) };
    let candidates = presets_of(place);
    let Some(preset) = candidates.iter().find(|preset| name == preset.name.as_str()) else {
        return Err(unknown(&name, place, &candidates));
    };
    let mut merged = preset.spec.clone();
    merge(&mut merged, Value::Object(fields));
    match merged {
        Value::Object(fields) => Ok(fields),
        other => Err(SpecError::one("preset", other.to_string(), "a preset that is an object")),
    }
}

fn unknown(name: &Value, place: PresetPlace, candidates: &[&Preset]) -> SpecError {
    let elsewhere = presets().iter().find(|preset| *name == preset.name.as_str());
    if let Some(elsewhere) = elsewhere {
        let allowed = match place {
            PresetPlace::Job => format!(
                "the preset of a job; this one is a model and belongs in a train job: \
                 {{\"kind\": \"train\", \"model\": {{\"preset\": {name}}}, ...}}"
            ),
            PresetPlace::Model => format!(
                "the preset of a model; this one is a job ({}) and belongs at the top of a spec",
                elsewhere.spec["kind"].as_str().unwrap_or_default()
            ),
        };
        return SpecError::one("preset", name.to_string(), allowed);
    }
    let names: Vec<String> = candidates.iter().map(|preset| preset.name.clone()).collect();
    let meant = nearest(name.as_str().unwrap_or_default(), names.iter().map(String::as_str));
    SpecError::one("preset", shorten(name), listed(&names, meant))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::{JobSpec, parse};

    #[test]
    fn every_file_is_called_as_its_preset() {
        for (file, _) in FILES {
            let (order, name) = file.split_once('-').unwrap();
            assert!(presets().iter().any(|preset| preset.name == name), "{file}");
            assert!(order.parse::<u32>().is_ok(), "{file}");
        }
    }

    #[test]
    fn every_job_preset_is_a_valid_job() {
        for preset in presets().iter().filter(|preset| preset.place == PresetPlace::Job) {
            let text = json!({"preset": preset.name}).to_string();
            parse(text.as_bytes()).unwrap_or_else(|error| panic!("{}: {error}", preset.name));
        }
    }

    #[test]
    fn every_model_preset_is_a_valid_model() {
        for preset in presets().iter().filter(|preset| preset.place == PresetPlace::Model) {
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
            assert_eq!(job("four-models", name), job("two-models", name));
        }
        assert_eq!(job("four-models", "robomorph"), job("two-models", "train"));
        for name in ["train-set", "robomorph", "cdt"] {
            assert_eq!(job("control", name), job("four-models", name));
        }
    }

    #[test]
    fn another_residual_replaces_that_of_the_preset() {
        let residual = json!({"lagged-integrator": {"damping": 8.0}});
        let text = json!({
            "kind": "train", "data": {"dataset": 1}, "steps": 1,
            "model": {"preset": "flow-tiny", "residual": residual},
        });
        let parsed = parse(text.to_string().as_bytes()).unwrap();
        assert_eq!(parsed.to_json()["model"]["residual"], residual);
    }

    #[test]
    fn fields_beside_a_preset_are_merged_over_it() {
        let text = json!({
            "preset": "two-models",
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
