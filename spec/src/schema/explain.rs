//! Explains everything that is wrong with the shape of a value, from its schema.

use serde_json::{Map, Value};
use strsim::damerau_levenshtein;

use super::words::{allowed, listed, range_of};
use super::{Components, RESOLVED, referred};
use crate::fields::shorten;
use crate::{Moment, Violation};

/// The violations of a schema.
#[derive(Default)]
pub(crate) struct Explained {
    pub violations: Vec<Violation>,
    /// Whether a violation is more than a number out of its range.
    pub is_misshapen: bool,
}

/// Checks `value` against the schema with this name.
pub(crate) fn explain(name: &str, value: &Value) -> Explained {
    explain_in(&RESOLVED, name, value)
}

pub(super) fn explain_in(components: &Components, name: &str, value: &Value) -> Explained {
    let mut walk = Walk { components, explained: Explained::default() };
    if let Some(schema) = components.get(name) {
        walk.value(schema, value, "");
    }
    walk.explained
}

/// The one of `names` that was probably meant.
pub(crate) fn nearest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let most = (name.chars().count() / 3).max(1);
    let distance = |known: &str| {
        let is_begun = name.len() >= 3 && known.starts_with(name);
        if is_begun { 0 } else { damerau_levenshtein(name, known) }
    };
    let near = names.map(|known| (distance(known), known)).filter(|(far, _)| *far <= most);
    near.min_by_key(|(far, _)| *far).map(|(_, known)| known)
}

struct Walk<'a> {
    components: &'a Components,
    explained: Explained,
}

impl<'a> Walk<'a> {
    fn resolve(&self, mut schema: &'a Value) -> &'a Value {
        while let Some(named) = referred(schema).and_then(|name| self.components.get(name)) {
            schema = named;
        }
        schema
    }

    fn refuse(&mut self, path: &str, value: impl Into<String>, allowed: impl Into<String>) {
        self.explained.is_misshapen = true;
        self.note(path, value, allowed);
    }

    fn note(&mut self, path: &str, value: impl Into<String>, allowed: impl Into<String>) {
        let (field, value, allowed) = (path.to_owned(), value.into(), allowed.into());
        self.explained.violations.push(Violation { field, value, allowed });
    }

    fn value(&mut self, schema: &'a Value, value: &Value, path: &str) {
        let schema = self.resolve(schema);
        if let Some(Value::Array(choices)) = schema.get("oneOf") {
            return self.choice(schema, choices, value, path);
        }
        if !has_type(schema, value) {
            return self.refuse(path, shorten(value), allowed(self.components, schema));
        }
        match value {
            Value::Object(fields) => self.object(schema, fields, path),
            Value::Array(items) => self.list(schema, items, path),
            Value::Number(_) => self.number(schema, value, path),
            Value::String(text) => self.text(schema, text, path),
            Value::Null | Value::Bool(_) => {}
        }
    }

    fn object(&mut self, schema: &'a Value, fields: &Map<String, Value>, path: &str) {
        let Some(known) = schema.get("properties").and_then(Value::as_object) else {
            if let Some(each) = schema.get("additionalProperties").filter(|value| value.is_object())
            {
                for (field, value) in fields {
                    self.value(each, value, &join(path, field));
                }
            }
            return;
        };
        for (field, value) in fields {
            match known.get(field) {
                Some(schema) => self.value(schema, value, &join(path, field)),
                None => self.unknown(known, path, field),
            }
        }
        for field in schema["required"].as_array().into_iter().flatten() {
            let Some(field) = field.as_str().filter(|field| !fields.contains_key(*field)) else {
                continue;
            };
            let schema = known.get(field).map(|schema| self.resolve(schema));
            let allowed = schema.map(|schema| allowed(self.components, schema));
            self.refuse(&join(path, field), "missing", allowed.unwrap_or_default());
        }
    }

    fn unknown(&mut self, known: &Map<String, Value>, path: &str, field: &str) {
        let allowed = match nearest(field, known.keys().map(String::as_str)) {
            Some(meant) => format!("unknown field; did you mean `{meant}`?"),
            None => {
                let names: Vec<&str> = known.keys().map(String::as_str).collect();
                format!("unknown field; known here: {}", names.join(", "))
            }
        };
        self.refuse(&join(path, field), "", allowed);
    }

    fn list(&mut self, schema: &'a Value, items: &[Value], path: &str) {
        let bound = |keyword: &str| schema.get(keyword).and_then(Value::as_u64);
        let exact = bound("minItems").filter(|least| bound("maxItems") == Some(*least));
        if exact.is_some_and(|exact| exact != items.len() as u64) {
            return self.refuse(
                path,
                shorten(&Value::Array(items.to_vec())),
                allowed(self.components, schema),
            );
        }
        let Some(each) = schema.get("items") else { return };
        for (i, item) in items.iter().enumerate() {
            self.value(each, item, &format!("{path}[{i}]"));
        }
    }

    fn number(&mut self, schema: &Value, value: &Value, path: &str) {
        let Some(number) = value.as_f64() else { return };
        let bound = |keyword: &str| schema.get(keyword).and_then(Value::as_f64);
        let is_inside = bound("minimum").is_none_or(|least| least <= number)
            && bound("maximum").is_none_or(|most| number <= most)
            && bound("exclusiveMaximum").is_none_or(|most| number < most);
        if !is_inside {
            self.note(path, value.to_string(), range_of(schema));
        }
    }

    fn text(&mut self, schema: &'a Value, text: &str, path: &str) {
        let names = schema.get("enum").and_then(Value::as_array);
        let is_name = names.is_none_or(|names| names.iter().any(|name| name == text));
        let is_const = schema.get("const").is_none_or(|name| name == text);
        let is_digest = schema.get("pattern").is_none()
            || text.len() == 64 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
        let is_moment = schema.get("format").is_none_or(|format| format != "date-time")
            || text.parse::<Moment>().is_ok();
        if is_name && is_const && is_digest && is_moment {
            return;
        }
        let names = names.into_iter().flatten().filter_map(Value::as_str);
        let mut words = allowed(self.components, schema);
        if let Some(meant) = nearest(text, names) {
            words = format!("{words}; did you mean `{meant}`?");
        }
        self.refuse(path, shorten(&text.into()), words);
    }

    /// Checks one of several forms. They differ by a tag, by their only field, or by their types.
    fn choice(&mut self, schema: &'a Value, choices: &'a [Value], value: &Value, path: &str) {
        let choices: Vec<&'a Value> = choices.iter().map(|choice| self.resolve(choice)).collect();
        if let (Value::Object(fields), Some(tag)) = (value, tag_of(&choices)) {
            return self.tagged(&choices, tag, fields, value, path);
        }
        let fits = |choice: &&Value| match (value, only_field(choice)) {
            (Value::Object(fields), Some(field)) => fields.contains_key(field),
            _ => has_type(choice, value),
        };
        let misses_name = |choice: &Value| {
            let names = choice.get("enum").and_then(Value::as_array);
            names.is_some_and(|names| !names.contains(value))
        };
        match choices.iter().copied().find(fits) {
            Some(choice) if !misses_name(choice) => self.value(choice, value, path),
            _ => self.refuse(path, shorten(value), allowed(self.components, schema)),
        }
    }

    fn tagged(
        &mut self,
        choices: &[&'a Value],
        tag: &str,
        fields: &Map<String, Value>,
        value: &Value,
        path: &str,
    ) {
        let label = |choice: &Value| label_of(choice, tag).map(str::to_owned);
        let labels: Vec<String> = choices.iter().filter_map(|choice| label(choice)).collect();
        let field = join(path, tag);
        match fields.get(tag) {
            None => self.refuse(&field, "missing", labels.join(", ")),
            Some(Value::String(given)) if labels.contains(given) => {
                let mut choices = choices.iter().copied();
                let chosen = choices.find(|choice| label(choice).as_ref() == Some(given));
                if let Some(chosen) = chosen {
                    self.value(chosen, value, path);
                }
            }
            Some(given) => {
                let text = given.as_str().unwrap_or_default();
                let meant = nearest(text, labels.iter().map(String::as_str));
                self.refuse(&field, shorten(given), listed(&labels, meant));
            }
        }
    }
}

pub(super) fn join(path: &str, field: &str) -> String {
    if path.is_empty() { field.to_owned() } else { format!("{path}.{field}") }
}

/// The field that all choices have, each with one value of its own.
fn tag_of<'a>(choices: &[&'a Value]) -> Option<&'a str> {
    let objects = || choices.iter().filter(|choice| choice.get("properties").is_some());
    let fields = objects().next()?["properties"].as_object()?;
    let mut tags = fields.keys().map(String::as_str);
    tags.find(|tag| objects().all(|choice| label_of(choice, tag).is_some()))
}

fn label_of<'a>(choice: &'a Value, tag: &str) -> Option<&'a str> {
    let schema = choice.get("properties")?.get(tag)?;
    let label = schema.get("const").or_else(|| match schema.get("enum")?.as_array()?.as_slice() {
        [only] => Some(only),
        _ => None,
    });
    label?.as_str()
}

/// The only field of an object with one required field.
pub(super) fn only_field(schema: &Value) -> Option<&str> {
    let fields = schema.get("properties")?.as_object()?;
    let (field, _) = fields.iter().next().filter(|_| fields.len() == 1)?;
    let required = schema.get("required")?.as_array()?;
    required.iter().any(|name| name == field.as_str()).then_some(field)
}

fn has_type(schema: &Value, value: &Value) -> bool {
    let is = |name: &str| match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        "number" => value.is_number(),
        "integer" => value.is_i64() || value.is_u64(),
        _ => true,
    };
    match schema.get("type") {
        Some(Value::String(name)) => is(name),
        Some(Value::Array(names)) => names.iter().filter_map(Value::as_str).any(is),
        _ => true,
    }
}
