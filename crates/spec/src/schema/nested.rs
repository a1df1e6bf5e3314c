//! The fields of objects that are fields of an object.

use std::collections::BTreeSet;

use serde_json::{Map, Value};

use super::words::{Components, referred};

/// How many objects a path leads through at most. Fields that lie deeper are not what somebody forgot
/// to nest.
const DEEPEST: usize = 3;

/// The paths to fields called `name` in the objects among `fields`: the shortest ones only.
pub(super) fn paths_to(
    components: &Components,
    fields: &Map<String, Value>,
    name: &str,
) -> Vec<String> {
    let mut level = vec![(String::new(), fields)];
    for _ in 0..DEEPEST {
        let mut below = Vec::new();
        for (path, fields) in level {
            for (field, schema) in fields {
                let within = format!("{path}{field}.");
                let objects = objects_of(components, schema);
                below.extend(objects.into_iter().map(|fields| (within.clone(), fields)));
            }
        }
        // A choice of objects may have the field in several of them.
        let found: BTreeSet<String> = below
            .iter()
            .filter(|(_, fields)| fields.contains_key(name))
            .map(|(within, _)| format!("{within}{name}"))
            .collect();
        if !found.is_empty() {
            return found.into_iter().collect();
        }
        level = below;
    }
    Vec::new()
}

/// The fields of the objects that a value of `schema` may be.
fn objects_of<'a>(components: &'a Components, schema: &'a Value) -> Vec<&'a Map<String, Value>> {
    let mut schema = schema;
    while let Some(named) = referred(schema).and_then(|name| components.get(name)) {
        schema = named;
    }
    if let Some(Value::Array(choices)) = schema.get("oneOf") {
        return choices.iter().flat_map(|choice| objects_of(components, choice)).collect();
    }
    schema.get("properties").and_then(Value::as_object).into_iter().collect()
}
