//! The bounds of numbers in the schemas. They come from the checks of values.
//!
//! A check reports its bounds when it runs. The specs of the folder `specimens` contain every
//! number that there is, and a test finds numbers that are missing there.

use std::collections::BTreeMap;

use serde_json::Value;

use super::words::{Components, referred};
use crate::JobSpec;
use crate::check::{Bound, Bounded, Check, Violations};

const SPECIMENS: [&str; 4] = [
    include_str!("../../specimens/jobs.json"),
    include_str!("../../specimens/models.json"),
    include_str!("../../specimens/robot.json"),
    include_str!("../../specimens/pipeline.json"),
];

/// Adds the bounds to `components`. If two places of a schema have different bounds, the wider ones
/// are used.
pub(super) fn add(components: &mut Components) {
    let mut schemas = Value::Object(std::mem::take(components));
    let mut widest: BTreeMap<(String, &'static str), Value> = BTreeMap::new();
    for spec in specimens() {
        let root = format!("/{}", root_of(&spec));
        let mut violations = Violations::with_bounds();
        spec.check(&mut violations);
        for bound in violations.into_bounds() {
            for place in places(&schemas, &root, &bound) {
                note(&mut widest, &place, &bound, &schemas);
            }
        }
    }
    for ((place, keyword), value) in widest {
        if let Some(Value::Object(schema)) = schemas.pointer_mut(&place) {
            schema.insert(keyword.to_owned(), value);
        }
    }
    if let Value::Object(schemas) = schemas {
        *components = schemas;
    }
}

/// # Panics
/// If a file of the folder `specimens` is not a list of specs. A test checks that each is.
fn specimens() -> impl Iterator<Item = JobSpec> {
    SPECIMENS
        .into_iter()
        .flat_map(|text| serde_json::from_str::<Vec<JobSpec>>(text).expect("specimens are specs"))
}

/// The schema of a spec's fields.
fn root_of(spec: &JobSpec) -> &'static str {
    match spec {
        JobSpec::Simulate(_) => "SimulateSpec",
        JobSpec::Train(_) => "TrainSpec",
        JobSpec::Evaluate(_) => "EvaluateSpec",
        JobSpec::Control(_) => "ControlSpec",
        JobSpec::Import(_) => "ImportSpec",
        JobSpec::Verify(_) => "VerifySpec",
        JobSpec::Identify(_) => "IdentifySpec",
        JobSpec::Pipeline(_) => "PipelineSpec",
    }
}

/// Pointers to the schemas of a bound's field.
fn places(schemas: &Value, root: &str, bound: &Bound) -> Vec<String> {
    let path = bound.field.replace('[', ".[");
    let mut places = alternatives(schemas, root);
    for step in path.split('.') {
        places = places.iter().flat_map(|place| inside(schemas, place, step)).collect();
    }
    if bound.of == Bounded::Length {
        return places;
    }
    // The bound applies to a list's numbers.
    let numbers = |place: String| match schemas.pointer(&format!("{place}/items")) {
        Some(_) => format!("{place}/items"),
        None => place,
    };
    places.into_iter().map(numbers).collect()
}

/// The schemas that a schema refers to or offers as alternatives.
fn alternatives(schemas: &Value, place: &str) -> Vec<String> {
    let Some(schema) = schemas.pointer(place) else { return Vec::new() };
    if let Some(name) = referred(schema) {
        return alternatives(schemas, &format!("/{name}"));
    }
    for choice in ["oneOf", "allOf"] {
        if let Some(Value::Array(choices)) = schema.get(choice) {
            let places = (0..choices.len()).map(|i| format!("{place}/{choice}/{i}"));
            return places.flat_map(|place| alternatives(schemas, &place)).collect();
        }
    }
    vec![place.to_owned()]
}

fn inside(schemas: &Value, place: &str, step: &str) -> Vec<String> {
    let candidates = [format!("{place}/items"), format!("{place}/properties/{step}")];
    let found = candidates.iter().find(|place| schemas.pointer(place).is_some());
    found.map(|place| alternatives(schemas, place)).unwrap_or_default()
}

fn note(
    widest: &mut BTreeMap<(String, &'static str), Value>,
    place: &str,
    bound: &Bound,
    schemas: &Value,
) {
    let Some(schema) = schemas.pointer(place) else { return };
    let has_type = |name: &str| match &schema["type"] {
        Value::Array(types) => types.iter().any(|known| known == name),
        one => one == name,
    };
    let keywords = match bound.of {
        Bounded::Value if has_type("number") || has_type("integer") => ["minimum", "maximum"],
        Bounded::ValueBelow => ["minimum", "exclusiveMaximum"],
        Bounded::Length if has_type("array") => ["minItems", "maxItems"],
        Bounded::Length if has_type("string") => ["minLength", "maxLength"],
        _ => return,
    };
    let wider = |old: &Value, new: &Value, upper: bool| match (old.as_f64(), new.as_f64()) {
        (Some(old), Some(new)) => (new > old) == upper,
        _ => false,
    };
    for (keyword, value, upper) in
        [(keywords[0], &bound.least, false), (keywords[1], &bound.most, true)]
    {
        let slot = widest.entry((place.to_owned(), keyword)).or_insert_with(|| value.clone());
        if wider(slot, value, upper) {
            *slot = value.clone();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::RESOLVED;
    use super::*;

    /// Numbers without bounds in checks: ids, the steps of a training, and steps that must be below
    /// those of the spec.
    const UNBOUNDED: [&str; 4] = ["dataset", "checkpoint", "step", "warmup_steps"];

    fn find_unbounded(schema: &Value, path: &str, found: &mut Vec<String>) {
        let types = schema.get("type").map(ToString::to_string).unwrap_or_default();
        let is_number = types.contains("number") || types.contains("integer");
        let has = |keyword| schema.get(keyword).is_some();
        let is_bounded = has("minimum") && (has("maximum") || has("exclusiveMaximum"));
        let field = path.rsplit('/').next().unwrap_or_default();
        if is_number && !is_bounded && !UNBOUNDED.contains(&field) {
            found.push(path.to_owned());
        }
        match schema {
            Value::Object(fields) => {
                for (key, value) in fields {
                    find_unbounded(value, &format!("{path}/{key}"), found);
                }
            }
            Value::Array(items) => {
                for (i, value) in items.iter().enumerate() {
                    find_unbounded(value, &format!("{path}/{i}"), found);
                }
            }
            _ => {}
        }
    }

    #[test]
    fn every_number_of_a_spec_has_the_bounds_that_its_check_has() {
        let mut found = Vec::new();
        for (name, schema) in RESOLVED.iter().filter(|(name, _)| *name != "Range") {
            find_unbounded(schema, &format!("/{name}"), &mut found);
        }
        assert!(found.is_empty(), "a specimen must have these: {found:#?}");
        let samples = &RESOLVED["SimulateJob"]["properties"]["samples"];
        assert_eq!(
            (samples["minimum"].as_u64(), samples["maximum"].as_u64()),
            (Some(2), Some(10_000))
        );
    }
}
