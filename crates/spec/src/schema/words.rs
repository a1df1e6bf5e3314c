//! Describes schemas in words, for errors that say what is allowed.

use serde_json::{Map, Value};

/// Schemas by name.
pub(crate) type Components = Map<String, Value>;

/// The name that a schema refers to.
pub(crate) fn referred(schema: &Value) -> Option<&str> {
    schema.get("$ref")?.as_str()?.rsplit('/').next()
}

/// A schema that refers to another.
pub(crate) fn reference(name: &str) -> Value {
    serde_json::json!({ "$ref": format!("#/components/schemas/{name}") })
}

/// The values that `schema` allows, in words.
pub(super) fn allowed(components: &Components, schema: &Value) -> String {
    if let Some(named) = referred(schema).and_then(|name| components.get(name)) {
        return allowed(components, named);
    }
    if let Some(Value::Array(choices)) = schema.get("oneOf") {
        return either(choices.iter().flat_map(|choice| forms(components, choice)).collect());
    }
    match &schema["type"] {
        Value::Array(types) => {
            let one = |name: &Value| {
                let mut single = schema.clone();
                single["type"] = name.clone();
                allowed(components, &single)
            };
            either(types.iter().map(one).collect())
        }
        Value::String(name) => of_type(components, schema, name),
        _ => "a JSON value".to_owned(),
    }
}

fn of_type(components: &Components, schema: &Value, name: &str) -> String {
    match name {
        "null" => "null".to_owned(),
        "boolean" => "true or false".to_owned(),
        "integer" => numbers("a whole number", schema),
        "number" => numbers("a number", schema),
        "string" => text(schema),
        "array" => list(components, schema),
        _ => object(schema),
    }
}

/// The values of a choice as JSON, with names in quotes.
fn forms(components: &Components, choice: &Value) -> Vec<String> {
    let choice = referred(choice).and_then(|name| components.get(name)).unwrap_or(choice);
    if let Some(names) = choice.get("enum").and_then(Value::as_array) {
        return names.iter().map(ToString::to_string).collect();
    }
    match only_field(choice) {
        Some(field) => vec![format!("{{\"{field}\": ...}}")],
        None => vec![allowed(components, choice)],
    }
}

fn either(mut forms: Vec<String>) -> String {
    match forms.pop() {
        None => String::new(),
        Some(last) if forms.is_empty() => last,
        Some(last) => format!("{} or {last}", forms.join(", ")),
    }
}

fn numbers(kind: &str, schema: &Value) -> String {
    match schema.get("maximum").or(schema.get("exclusiveMaximum")) {
        Some(_) => format!("{kind} from {}", range_of(schema)),
        None => kind.to_owned(),
    }
}

/// The bounds of a number, e.g. `1 to 1000`.
pub(super) fn range_of(schema: &Value) -> String {
    let number = |keyword: &str| {
        let value = schema.get(keyword)?;
        value
            .as_u64()
            .map(|number| number.to_string())
            .or_else(|| Some(value.as_f64()?.to_string()))
    };
    match (number("minimum"), number("maximum"), number("exclusiveMaximum")) {
        (Some(least), Some(most), _) => format!("{least} to {most}"),
        (Some(least), None, Some(most)) => format!("{least} to below {most}"),
        (Some(least), None, None) => format!("{least} or more"),
        _ => "a number".to_owned(),
    }
}

fn text(schema: &Value) -> String {
    if let Some(names) = schema.get("enum").and_then(Value::as_array) {
        let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
        return names.join(", ");
    }
    if let Some(name) = schema.get("const").and_then(Value::as_str) {
        return name.to_owned();
    }
    if schema.get("pattern").is_some() {
        return "64 hexadecimal digits of a SHA-256".to_owned();
    }
    if schema.get("format").is_some_and(|format| format == "date-time") {
        return "a moment with its zone, such as 2026-12-01T08:00:00Z or 2026-12-01T09:00:00+01:00"
            .to_owned();
    }
    "a text".to_owned()
}

fn list(components: &Components, schema: &Value) -> String {
    let each = schema.get("items").map(|items| allowed(components, items)).unwrap_or_default();
    let count = |keyword: &str| schema.get(keyword).and_then(Value::as_u64);
    match (count("minItems"), count("maxItems")) {
        (Some(2), Some(2)) if is_interval(schema) => format!("[min, max], each {each}"),
        (Some(least), Some(most)) if least == most => format!("a list of {most}, each {each}"),
        _ => format!("a list, each item {each}"),
    }
}

/// Whether a list of two numbers is an interval. The numbers of other lists have the format of
/// their type.
fn is_interval(schema: &Value) -> bool {
    let items = &schema["items"];
    items["type"] == "number" && items.get("format").is_none()
}

fn object(schema: &Value) -> String {
    let fields = schema.get("properties").and_then(Value::as_object);
    let names: Vec<&str> = fields.into_iter().flatten().map(|(name, _)| name.as_str()).collect();
    if names.is_empty() {
        "an object".to_owned()
    } else {
        format!("an object with {}", names.join(", "))
    }
}

/// The only field of an object with one required field.
pub(super) fn only_field(schema: &Value) -> Option<&str> {
    let fields = schema.get("properties")?.as_object()?;
    let (field, _) = fields.iter().next().filter(|_| fields.len() == 1)?;
    let required = schema.get("required")?.as_array()?;
    required.iter().any(|name| name == field.as_str()).then_some(field)
}
