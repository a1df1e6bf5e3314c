//! Schemas of submitted specs. They may have presets, which allow fields to be left out.

use serde_json::{Map, Value, json};

use super::resolved::require;
use super::words::{Components, reference, referred};
use crate::merge::REPLACED_WHOLE;
use crate::{JobKind, PresetPlace, presets};

/// All schemas of the document.
pub(super) fn components(resolved: &Components) -> Components {
    let mut forms = Forms { resolved, added: Components::new() };
    let models = forms.models();
    let jobs = forms.jobs("Job");
    let members = forms.jobs("Member");

    let mut all = resolved.clone();
    all.extend(forms.added);
    add_choices(&mut all, "ModelSpec", &models);
    add_choices(&mut all, "PipelineMember", &members);
    let mut submitted = all["JobSpec"].clone();
    submitted["description"] =
        "Anything that can be submitted: a job whose `kind` is given, or a `preset` \
                                with fields merged over it."
            .into();
    all.insert("SubmittedJob".to_owned(), submitted);
    add_choices(&mut all, "SubmittedJob", &jobs);
    loosen_stream(&mut all);
    loosen_import(&mut all);
    name_stored_robots(&mut all);
    all
}

/// Allows references to the robots that a server keeps.
fn name_stored_robots(all: &mut Components) {
    let reference = |name: &str, schema: Value, about: &str| {
        json!({
            "type": "object", "description": about, "additionalProperties": false,
            "properties": {name: schema}, "required": [name],
        })
    };
    if let Some(Value::Array(choices)) = all.get_mut("RobotModel").map(|model| &mut model["oneOf"])
    {
        let id = json!({"type": "integer", "format": "int64", "minimum": 1});
        choices.push(reference("robot", id, "A robot of this server, by its id."));
        let digest = json!({"type": "string", "pattern": "^[0-9a-fA-F]{64}$"});
        let about = "A robot of this server, by the digest of its description.";
        choices.push(reference("digest", digest, about));
    }
}

/// Adds `more` choices to a union. They have no tag that identifies them.
fn add_choices(all: &mut Components, name: &str, more: &[String]) {
    let Some(union) = all.get_mut(name).and_then(Value::as_object_mut) else { return };
    if more.is_empty() {
        return;
    }
    union.remove("discriminator");
    if let Some(Value::Array(choices)) = union.get_mut("oneOf") {
        choices.extend(more.iter().map(|name| reference(name)));
    }
}

/// Allows the `kind` of a copied job in a stream, and a training's stream without a number of
/// trajectories.
fn loosen_stream(all: &mut Components) {
    let mut stream = all["SimulateSpec"].clone();
    stream["properties"]["kind"] = json!({"type": "string", "const": "simulate"});
    stream["required"] = json!(["excitation"]);
    stream["description"] =
        "A simulation that is never stored. Only that of a training may leave out \
                             `trajectories`."
            .into();
    all.insert("StreamSpec".to_owned(), stream);
    let choices = all.get_mut("DataSource").and_then(|component| component["oneOf"].as_array_mut());
    for choice in choices.into_iter().flatten() {
        if let Some(stream) = choice["properties"].get_mut("stream") {
            *stream =
                json!({"oneOf": [reference("StreamSpec"), reference("SimulateJobFromPreset")]});
        }
    }
}

/// The spec of an upload. Its digest and format follow from the file that it comes with.
fn loosen_import(all: &mut Components) {
    let Some(spec) = all.get_mut("ImportSpec") else { return };
    spec["properties"]["kind"] = json!({"type": "string", "const": "import"});
    spec["required"] = json!(["columns"]);
}

/// Builds forms with presets.
struct Forms<'a> {
    resolved: &'a Components,
    added: Components,
}

impl Forms<'_> {
    /// Adds a form for each architecture that has presets.
    fn models(&mut self) -> Vec<String> {
        let mapping = &self.resolved["ModelSpec"]["discriminator"]["mapping"];
        self.with_presets(mapping, "architecture", PresetPlace::Model)
    }

    /// Adds a form for each kind of job that has presets. `suffix` is `Job`, or `Member` in a
    /// pipeline.
    fn jobs(&mut self, suffix: &str) -> Vec<String> {
        let union = if suffix == "Job" { "JobSpec" } else { "PipelineMember" };
        let mapping = &self.resolved[union]["discriminator"]["mapping"];
        self.with_presets(mapping, "kind", PresetPlace::Job)
    }

    fn with_presets(&mut self, mapping: &Value, tag: &str, place: PresetPlace) -> Vec<String> {
        let mut forms = Vec::new();
        for (label, target) in mapping.as_object().into_iter().flatten() {
            let Some(base) = target.as_str().and_then(|target| target.rsplit('/').next()) else {
                continue;
            };
            let names: Vec<&str> = presets()
                .iter()
                .filter(|preset| preset.place == place && preset.spec[tag] == label.as_str())
                .map(|preset| preset.name.as_str())
                .collect();
            if names.is_empty() {
                continue;
            }
            let mut form = self.changed(base);
            form["properties"]["preset"] = json!({"type": "string", "enum": names});
            require(&mut form, "preset");
            form["description"] =
                format!("A preset, with the other fields merged over it. {}", about(&form)).into();
            let name = format!("{base}FromPreset");
            self.added.insert(name.clone(), form);
            forms.push(name);
        }
        forms
    }

    /// The object `name` with all fields optional, because it is merged over another one.
    fn changed(&mut self, name: &str) -> Value {
        let mut object = self.resolved[name].clone();
        if let Some(fields) = object.as_object_mut() {
            fields.remove("required");
        }
        if let Some(properties) = object.get_mut("properties").and_then(Value::as_object_mut) {
            for (field, schema) in properties {
                if !REPLACED_WHOLE.contains(&field.as_str()) {
                    self.change(schema);
                }
            }
        }
        if let Some(each) = object.get_mut("additionalProperties").filter(|value| value.is_object())
        {
            self.change(each);
        }
        object
    }

    /// Makes `schema` refer to the changes of an object instead of the object.
    fn change(&mut self, schema: &mut Value) {
        if let Some(Value::Array(choices)) = schema.get_mut("oneOf") {
            return choices.iter_mut().for_each(|choice| self.change(choice));
        }
        if schema.get("additionalProperties").is_some_and(Value::is_object) {
            return self.change(&mut schema["additionalProperties"]);
        }
        let Some(name) = referred(schema).map(str::to_owned) else { return };
        let Some(target) = self.resolved.get(&name) else { return };
        let changes = format!("{name}Changes");
        if let Some(mapping) = target.pointer("/discriminator/mapping").and_then(Value::as_object) {
            self.change_union(&name, mapping, &changes);
        } else if target.get("properties").is_some() {
            if !self.added.contains_key(&changes) {
                self.added.insert(changes.clone(), Value::Null);
                let object = self.changed(&name);
                self.added.insert(changes.clone(), object);
            }
        } else {
            return;
        }
        schema["$ref"] = reference(&changes)["$ref"].clone();
    }

    /// Changes of one of several objects that a preset may have chosen. They may begin with another
    /// preset.
    fn change_union(&mut self, name: &str, mapping: &Map<String, Value>, changes: &str) {
        if self.added.contains_key(changes) {
            return;
        }
        self.added.insert(changes.to_owned(), Value::Null);
        let place = if name == "ModelSpec" { PresetPlace::Model } else { PresetPlace::Job };
        let names: Vec<&str> = presets()
            .iter()
            .filter(|preset| {
                preset.place == place && preset.spec["kind"] != JobKind::Pipeline.as_str()
            })
            .map(|preset| preset.name.as_str())
            .collect();
        let mut choices = Vec::new();
        for target in mapping.values() {
            let Some(base) = target.as_str().and_then(|target| target.rsplit('/').next()) else {
                continue;
            };
            let mut object = self.changed(base);
            object["properties"]["preset"] = json!({"type": "string", "enum": names});
            let name = format!("{base}Changes");
            choices.push(reference(&name));
            self.added.insert(name, object);
        }
        let union = json!({"description": "Fields that are merged over those of a preset.", "anyOf": choices});
        self.added.insert(changes.to_owned(), union);
    }
}

fn about(form: &Value) -> &str {
    form["description"].as_str().unwrap_or_default()
}
