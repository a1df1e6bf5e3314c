//! A spec as a form: one input per field, with what the OpenAPI document says about it.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde_json::{Value, json};
use spec::{SpecError, Violation};

use crate::app::labels::is_alias;

/// The document, where fields are described.
static DOCUMENT: LazyLock<Value> = LazyLock::new(crate::routes::openapi);

/// The prefix of a field's name in the form.
const NAMED: &str = "set:";

/// The section of fields that a spec leaves out.
const LEFT_OUT: &str = "left out";

/// The longest chain of references that is followed to a field's description.
const DEEPEST: usize = 12;

/// The fields of a job.
pub struct Group {
    /// The name of the job in its pipeline; empty for a single job.
    pub name: String,
    /// The fields of the job itself, then those of each object in it.
    pub sections: Vec<Section>,
}

/// The fields of an object in a spec.
pub struct Section {
    /// The name of the object; empty for the job itself.
    pub name: String,
    pub fields: Vec<Field>,
}

impl Section {
    /// Its name in words.
    pub fn title(&self) -> String {
        self.name.replace('_', " ")
    }

    /// Whether something was typed into it, or is wrong in it.
    pub fn is_open(&self) -> bool {
        let is_touched = |field: &Field| !field.value.is_empty() || !field.violation.is_empty();
        self.name.is_empty() || self.fields.iter().any(is_touched)
    }
}

impl Group {
    /// The paths of its fields.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.sections.iter().flat_map(|section| &section.fields).map(|field| &*field.path)
    }

    fn fields(&mut self) -> impl Iterator<Item = &mut Field> {
        self.sections.iter_mut().flat_map(|section| &mut section.fields)
    }
}

/// A field of a spec.
pub struct Field {
    /// The path in the spec, e.g. `optimizer.learning_rate`.
    pub path: String,
    /// The path within its group.
    pub label: String,
    /// The value without a change.
    pub placeholder: String,
    /// The typed text; an empty one leaves the field as it is.
    pub value: String,
    pub about: String,
    /// The allowed words, if these are all.
    pub choices: Vec<String>,
    /// Why what was typed is refused; empty before.
    pub violation: String,
}

impl Field {
    /// Whether it names checkpoints, of which the form has a list.
    pub fn names_checkpoints(&self) -> bool {
        names_checkpoints(&self.path)
    }

    /// The name of its input.
    pub fn name(&self) -> String {
        format!("{NAMED}{}", self.path)
    }
}

/// What was typed into a form, by the paths of fields.
#[derive(Clone, Debug, Default)]
pub struct Changes(BTreeMap<String, String>);

impl Changes {
    /// Reads the fields of a form, and leaves out empty ones.
    pub fn read(pairs: &[(String, String)]) -> Self {
        let typed = pairs.iter().filter_map(|(name, value)| {
            let path = name.strip_prefix(NAMED)?;
            let value = value.trim();
            (!value.is_empty()).then(|| (path.to_owned(), value.to_owned()))
        });
        Self(typed.collect())
    }

    /// The spec with the typed values.
    ///
    /// # Errors
    /// Names each path whose object the spec does not have.
    pub fn applied(&self, spec: &Value) -> Result<Value, SpecError> {
        let mut changed = spec.clone();
        let mut error = SpecError::default();
        for (path, typed) in &self.0 {
            let value =
                if names_checkpoints(path) { checkpoints_of(typed) } else { value_of(typed) };
            if !put(&mut changed, path, value) {
                let allowed = "a field of the spec below";
                error.violations.push(Violation::new(path.clone(), typed.clone(), allowed));
            }
        }
        if error.is_empty() { Ok(changed) } else { Err(error) }
    }
}

/// Sets a field of an object that is there. Says whether it is.
pub(super) fn put(spec: &mut Value, path: &str, value: Value) -> bool {
    let (object, name) = path.rsplit_once('.').unwrap_or(("", path));
    let object = if object.is_empty() { Some(spec) } else { spec.pointer_mut(&pointer(object)) };
    let fields = object.and_then(Value::as_object_mut);
    fields.map(|fields| fields.insert(name.to_owned(), value)).is_some()
}

/// A JSON value, or else the text itself: `200`, `true`, `["a"]`, `multisine`.
pub fn value_of(typed: &str) -> Value {
    serde_json::from_str(typed).unwrap_or_else(|_| Value::from(typed))
}

/// Whether a field has a list of checkpoints.
pub fn names_checkpoints(path: &str) -> bool {
    path.rsplit('.').next() == Some("checkpoints")
}

/// Checkpoints as a spec names them. People type ids and aliases: `8, 9` or `champion`.
fn checkpoints_of(typed: &str) -> Value {
    let of_id = |value: Value| match value.is_u64() {
        true => json!({ "checkpoint": value }),
        false => value,
    };
    match serde_json::from_str(typed) {
        Ok(Value::Array(list)) => list.into_iter().map(of_id).collect(),
        Ok(Value::Number(id)) => Value::from(vec![of_id(id.into())]),
        Ok(other) => other,
        Err(_) => {
            let words = typed.split([',', ' ', ';']).filter(|word| !word.is_empty());
            let one = |word: &str| {
                let alias = word.trim_start_matches('@');
                match alias.parse::<u64>() {
                    Ok(id) => Some(of_id(id.into())),
                    Err(_) => is_alias(alias).then(|| json!({ "alias": alias })),
                }
            };
            let all: Option<Vec<Value>> = words.map(one).collect();
            all.map_or_else(|| Value::from(typed), Value::from)
        }
    }
}

/// Several values in one line: a JSON list, or values separated by commas.
pub fn values_of(typed: &str) -> Vec<Value> {
    match serde_json::from_str(typed) {
        Ok(Value::Array(values)) => values,
        _ => typed.split(',').map(str::trim).filter(|it| !it.is_empty()).map(value_of).collect(),
    }
}

/// The inputs for a spec with every default filled in. Violations stand beside their fields; those
/// of other fields are returned.
pub fn groups(
    spec: &Value,
    changes: &Changes,
    violations: Vec<Violation>,
) -> (Vec<Group>, Vec<Violation>) {
    let mut groups = Vec::new();
    let parts: Vec<(String, String, &Value)> = match spec["jobs"].as_object() {
        Some(jobs) if spec["kind"] == "pipeline" => {
            jobs.iter().map(|(name, job)| (name.clone(), format!("jobs.{name}."), job)).collect()
        }
        _ => vec![(String::new(), String::new(), spec)],
    };
    for (name, prefix, job) in parts {
        let mut leaves = Vec::new();
        collect(job, String::new(), &mut leaves);
        let schema = schema_of(job);
        let mut sections = vec![Section { name: String::new(), fields: Vec::new() }];
        for (label, value) in leaves.into_iter().filter(|(label, _)| label != "kind") {
            let path = format!("{prefix}{label}");
            let described = schema.and_then(|schema| find(schema, &label));
            let section = label.split_once('.').map_or("", |(object, _)| object);
            let place = sections.iter().position(|known| known.name == section);
            let place = place.unwrap_or_else(|| {
                sections.push(Section { name: section.to_owned(), fields: Vec::new() });
                sections.len() - 1
            });
            sections[place].fields.push(Field {
                placeholder: shown(value),
                value: changes.0.get(&path).cloned().unwrap_or_default(),
                about: described.map(about).unwrap_or_default() + hint(&label),
                choices: described.map(|it| choices(it, value)).unwrap_or_default(),
                violation: String::new(),
                label,
                path,
            });
        }
        let optional = schema.and_then(|schema| schema["properties"].as_object());
        let optional = optional
            .into_iter()
            .flatten()
            .filter(|(label, _)| *label != "kind" && job.get(label.as_str()).is_none());
        let optional = optional.map(|(label, schema)| {
            let path = format!("{prefix}{label}");
            Field {
                placeholder: "left out".to_owned(),
                value: changes.0.get(&path).cloned().unwrap_or_default(),
                about: about(schema) + hint(label),
                choices: Vec::new(),
                violation: String::new(),
                label: label.clone(),
                path,
            }
        });
        sections.push(Section { name: LEFT_OUT.to_owned(), fields: optional.collect() });
        sections.retain(|section| !section.fields.is_empty());
        groups.push(Group { name, sections });
    }
    let rest = violations.into_iter().filter(|violation| {
        let mut fields = groups.iter_mut().flat_map(Group::fields);
        let of_it = |field: &&mut Field| {
            violation
                .field
                .strip_prefix(&field.path)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
        };
        match fields.find(of_it) {
            Some(field) => {
                field.violation = format!("allowed: {}", violation.allowed);
                false
            }
            None => true,
        }
    });
    let rest = rest.collect();
    (groups, rest)
}

fn pointer(path: &str) -> String {
    path.split('.').map(|step| format!("/{}", step.replace('~', "~0").replace('/', "~1"))).collect()
}

/// The values of a spec that are no objects, with their paths in order.
fn collect<'a>(value: &'a Value, path: String, leaves: &mut Vec<(String, &'a Value)>) {
    match value {
        Value::Object(fields) if !fields.is_empty() => {
            for (name, value) in fields {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                collect(value, path, leaves);
            }
        }
        _ => leaves.push((path, value)),
    }
}

/// A word without its quotation marks, and other values as JSON.
fn shown(value: &Value) -> String {
    match value {
        Value::String(word) => word.clone(),
        other => other.to_string(),
    }
}

/// The schema of a job of this kind.
fn schema_of(job: &Value) -> Option<&'static Value> {
    let kind = job["kind"].as_str()?;
    let mapping = DOCUMENT.pointer("/components/schemas/JobSpec/discriminator/mapping")?;
    resolved(mapping[kind].as_str()?)
}

fn resolved(reference: &str) -> Option<&'static Value> {
    DOCUMENT.pointer(reference.strip_prefix('#')?)
}

/// The schema of the field at `path`.
fn find(schema: &'static Value, path: &str) -> Option<&'static Value> {
    path.split('.').try_fold(schema, |schema, step| property(schema, step, DEEPEST))
}

/// The schema of a property, in the schema itself or in one that it is made of.
fn property(schema: &'static Value, name: &str, depth: usize) -> Option<&'static Value> {
    if let Some(found) = schema["properties"].get(name) {
        return Some(found);
    }
    let deeper = depth.checked_sub(1)?;
    if let Some(target) = schema["$ref"].as_str().and_then(resolved) {
        return property(target, name, deeper);
    }
    ["oneOf", "anyOf", "allOf"]
        .into_iter()
        .filter_map(|of| schema[of].as_array())
        .flatten()
        .find_map(|part| property(part, name, deeper))
}

/// How people may type what is a list of objects in JSON.
fn hint(label: &str) -> &'static str {
    if names_checkpoints(label) { " Ids or aliases will do: 8, 9 or champion." } else { "" }
}

/// What a field means, in its first paragraph.
fn about(schema: &'static Value) -> String {
    let own = schema["description"].as_str();
    let target = schema["$ref"].as_str().and_then(resolved);
    let text = own.or_else(|| target?["description"].as_str()).unwrap_or_default();
    text.split("\n\n").next().unwrap_or_default().replace('\n', " ").replace('`', "")
}

/// The words that the field may have, if its value is one of them.
fn choices(schema: &'static Value, value: &Value) -> Vec<String> {
    if value.is_boolean() {
        return vec!["true".to_owned(), "false".to_owned()];
    }
    let target = schema["$ref"].as_str().and_then(resolved).unwrap_or(schema);
    let parts = target["oneOf"].as_array().into_iter().flatten();
    let words = parts.chain([target]).filter_map(|part| part["enum"].as_array()).flatten();
    let words: Vec<String> = words.filter_map(|word| word.as_str().map(str::to_owned)).collect();
    let is_one = value.as_str().is_some_and(|value| words.iter().any(|word| word == value));
    if is_one { words } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn training() -> Value {
        let text =
            br#"{"kind": "train", "data": {"stream": {"preset": "D1-multisine"}}, "steps": 100,
            "batch_size": 4, "model": {"preset": "robomorph-tiny"}}"#;
        spec::parse(text).unwrap().to_json()
    }

    fn all(groups: &[Group]) -> impl Iterator<Item = &Field> {
        groups.iter().flat_map(|group| &group.sections).flat_map(|section| &section.fields)
    }

    fn field<'a>(groups: &'a [Group], path: &str) -> &'a Field {
        let mut fields = all(groups);
        fields.find(|field| field.path == path).unwrap_or_else(|| panic!("{path}"))
    }

    #[test]
    fn every_field_has_its_default_its_meaning_and_its_words() {
        let (groups, rest) = groups(&training(), &Changes::default(), Vec::new());
        assert_eq!((groups.len(), rest.len()), (1, 0));
        let rate = field(&groups, "optimizer.learning_rate");
        assert!(rate.placeholder.parse::<f64>().is_ok(), "{}", rate.placeholder);
        assert!(!rate.about.is_empty());
        assert!(field(&groups, "normalization").choices.contains(&"dataset".to_owned()));
        assert_eq!(field(&groups, "early_stop").placeholder, "left out");
        let without: Vec<&str> = all(&groups)
            .filter(|field| field.about.is_empty())
            .map(|field| field.path.as_str())
            .collect();
        assert!(without.len() * 5 < all(&groups).count(), "without a meaning: {without:?}");
    }

    #[test]
    fn what_is_typed_changes_the_spec_and_nothing_else_does() {
        let spec = training();
        let pairs = [
            ("set:steps", "7"),
            ("set:normalization", "dataset"),
            ("set:seed", " "),
            ("name", "x"),
        ];
        let pairs = pairs.map(|(name, value)| (name.to_owned(), value.to_owned()));
        let changed = Changes::read(&pairs).applied(&spec).unwrap();
        assert_eq!((&changed["steps"], &changed["normalization"]), (&json!(7), &json!("dataset")));
        let mut back = changed;
        (back["steps"], back["normalization"]) =
            (spec["steps"].clone(), spec["normalization"].clone());
        assert_eq!(back, spec);
        assert_eq!(Changes::default().applied(&spec).unwrap(), spec);
        let strange = Changes::read(&[("set:paint.colour".to_owned(), "red".to_owned())]);
        assert_eq!(strange.applied(&spec).unwrap_err().violations[0].field, "paint.colour");
        // A field that was left out.
        let early =
            Changes::read(&[("set:early_stop".to_owned(), r#"{"patience": 3}"#.to_owned())]);
        let early = early.applied(&spec).unwrap();
        assert_eq!(early["early_stop"]["patience"], 3);
    }

    #[test]
    fn checkpoints_are_typed_by_their_ids_and_aliases() {
        for (typed, expected) in [
            ("8", json!([{"checkpoint": 8}])),
            ("8, 9", json!([{"checkpoint": 8}, {"checkpoint": 9}])),
            ("[8, {\"alias\": \"a\"}]", json!([{"checkpoint": 8}, {"alias": "a"}])),
            (
                "champion @next 7",
                json!([{"alias": "champion"}, {"alias": "next"}, {"checkpoint": 7}]),
            ),
            ("8, -9", json!("8, -9")),
            ("[]", json!([])),
        ] {
            assert_eq!(checkpoints_of(typed), expected, "{typed}");
        }
    }

    #[test]
    fn a_violation_stands_beside_its_field_and_others_above_the_form() {
        let violations = vec![
            Violation::new("optimizer.learning_rate", "-1", "above 0"),
            Violation::new("steps_per_day", "1", "left out"),
        ];
        let (groups, rest) = groups(&training(), &Changes::default(), violations);
        assert_eq!(field(&groups, "optimizer.learning_rate").violation, "allowed: above 0");
        assert_eq!(rest.len(), 1, "{rest:?}");
        assert_eq!(all(&groups).filter(|field| !field.violation.is_empty()).count(), 1);
        let open: Vec<&str> = groups[0]
            .sections
            .iter()
            .filter(|section| section.is_open())
            .map(|section| section.name.as_str())
            .collect();
        assert_eq!(open, ["", "optimizer"]);
    }

    #[test]
    fn a_pipeline_has_a_group_for_each_job() {
        let preset = spec::presets().iter().find(|preset| preset.name == "two-models").unwrap();
        let spec = spec::parse_json(preset.spec.clone()).unwrap().to_json();
        let (groups, _) = groups(&spec, &Changes::default(), Vec::new());
        let names: Vec<&str> = groups.iter().map(|group| group.name.as_str()).collect();
        assert!(names.contains(&"train") && names.contains(&"evaluate"), "{names:?}");
        assert_eq!(field(&groups, "jobs.train.steps").label, "steps");
    }
}
