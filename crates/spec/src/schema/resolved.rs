//! Exact schemas of the types of specs.

use serde_json::{Map, Value, json};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::bounds;
use super::words::{Components, reference, referred};
use crate::{Integrator, JobSpec, PipelineMember, PipelineSpec, RobotModel};

/// Enums with a tag beside the fields of their variants.
const TAGGED: [&str; 2] = ["JobSpec", "ModelSpec"];

pub(super) fn components() -> Components {
    let mut components = strict(types());
    name_robots(&mut components);
    name_residuals(&mut components);
    bounds::add(&mut components);
    for name in TAGGED {
        join_tags(&mut components, name);
    }
    join_members(&mut components);
    components
}

/// The schemas from the types' attributes.
fn types() -> Vec<(String, RefOr<Schema>)> {
    let mut found = vec![
        (JobSpec::name().into_owned(), JobSpec::schema()),
        (PipelineMember::name().into_owned(), PipelineMember::schema()),
        (Integrator::name().into_owned(), Integrator::schema()),
    ];
    JobSpec::schemas(&mut found);
    PipelineSpec::schemas(&mut found);
    found
}

/// `schemas` as JSON. Objects allow only fields that are listed.
pub(super) fn strict(schemas: Vec<(String, RefOr<Schema>)>) -> Components {
    let json = |(name, schema)| {
        // Schemas have only strings, numbers and lists, so this cannot fail.
        let mut schema = serde_json::to_value(schema).expect("a schema is JSON");
        make_strict(&mut schema);
        (name, schema)
    };
    schemas.into_iter().map(json).collect()
}

/// Forbids unknown fields in objects. Gives intervals two numbers of their own, because each use
/// has its own bounds.
fn make_strict(schema: &mut Value) {
    if referred(schema) == Some("Range") {
        let about = schema.get("description").cloned();
        *schema = json!({
            "type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2,
        });
        if let Some(about) = about {
            schema["description"] = about;
        }
    }
    match schema {
        Value::Object(fields) => {
            let has_fields = fields.get("properties").is_some_and(Value::is_object);
            let is_object = fields.get("type").is_some_and(|value| value == "object");
            if has_fields && is_object && !fields.contains_key("additionalProperties") {
                fields.insert("additionalProperties".to_owned(), false.into());
            }
            fields.values_mut().for_each(make_strict);
        }
        Value::Array(items) => items.iter_mut().for_each(make_strict),
        _ => {}
    }
}

/// Allows the name of a built-in robot in place of a description.
fn name_robots(components: &mut Components) {
    let names: Vec<Value> =
        RobotModel::built_in().filter_map(|model| serde_json::to_value(model).ok()).collect();
    if let Some(name) =
        components.get_mut("RobotModel").and_then(|component| component.pointer_mut("/oneOf/0"))
    {
        *name = json!({"type": "string", "enum": names});
    }
}

/// Allows the name of a residual alone.
fn name_residuals(components: &mut Components) {
    let names = json!(["none", "integrator", "lagged-integrator"]);
    let schema = components.get_mut("Residual");
    if let Some(schema) = schema.and_then(|schema| schema.pointer_mut("/oneOf/0/enum")) {
        *schema = names;
    }
}

/// Merges "all of these fields and this tag" into one object with both. Otherwise strict fields
/// would contradict the tag. The object of `TrainSpec` in `JobSpec` is called `TrainJob`.
fn join_tags(components: &mut Components, name: &str) {
    let Some(union) = components.get(name).cloned() else { return };
    let suffix = name.strip_suffix("Spec").unwrap_or(name);
    let mut variants = Vec::new();
    let mut mapping = Map::new();
    let mut discriminator = String::new();
    for variant in union["oneOf"].as_array().into_iter().flatten() {
        let Some(spec) = referred(&variant["allOf"][0]) else { continue };
        let Some((tag, label)) = tag_of(&variant["allOf"][1]) else { continue };
        let joined = format!("{}{suffix}", spec.strip_suffix("Spec").unwrap_or(spec));
        let mut object = components.get(spec).cloned().unwrap_or_default();
        object["properties"][&tag] = json!({"type": "string", "const": label});
        require(&mut object, &tag);
        mapping.insert(label, reference(&joined)["$ref"].clone());
        variants.push(reference(&joined));
        components.insert(joined, object);
        discriminator = tag;
    }
    let union = json!({
        "description": union["description"], "oneOf": variants,
        "discriminator": {"propertyName": discriminator, "mapping": mapping},
    });
    components.insert(name.to_owned(), union);
}

/// The field that identifies a variant, and its value there.
fn tag_of(schema: &Value) -> Option<(String, String)> {
    let (tag, values) = schema.get("properties")?.as_object()?.iter().next()?;
    Some((tag.clone(), values["enum"][0].as_str()?.to_owned()))
}

pub(super) fn require(object: &mut Value, field: &str) {
    match &mut object["required"] {
        Value::Array(required) => required.push(field.into()),
        none => *none = json!([field]),
    }
}

/// A member of a pipeline: a job with `needs` among its fields, but no pipeline.
fn join_members(components: &mut Components) {
    let Some(member) = components.get("PipelineMember").cloned() else { return };
    let needs = member["allOf"][1]["properties"]["needs"].clone();
    let jobs = components["JobSpec"]["discriminator"]["mapping"].clone();
    let mut mapping = Map::new();
    for (kind, job) in jobs.as_object().into_iter().flatten() {
        let Some(job) = job.as_str().and_then(|target| target.rsplit('/').next()) else { continue };
        if job == "PipelineJob" {
            continue;
        }
        let name = job.replace("Job", "Member");
        let mut object = components.get(job).cloned().unwrap_or_default();
        object["properties"]["needs"] = needs.clone();
        mapping.insert(kind.clone(), reference(&name)["$ref"].clone());
        components.insert(name, object);
    }
    let variants: Vec<Value> = mapping.values().map(|target| json!({"$ref": target})).collect();
    let union = json!({
        "description": member["description"], "oneOf": variants,
        "discriminator": {"propertyName": "kind", "mapping": mapping},
    });
    components.insert("PipelineMember".to_owned(), union);
}
