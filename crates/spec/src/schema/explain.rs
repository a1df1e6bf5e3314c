//! Explains everything that is wrong with the shape of a value, from its schema.

use std::collections::HashSet;
use std::fmt::Write;

use serde_json::{Map, Value};

use super::nearest::{listed, nearest};
use super::nested::paths_to;
use super::words::{Components, allowed, only_field, range_of, referred};
use crate::error::FIELD_BYTES;
use crate::robot::allowed_for_misnamed;
use crate::shorten::shorten;
use crate::{Moment, SpecError, Violation};

/// The violations of a schema.
#[derive(Default)]
pub(crate) struct Explained {
    pub error: SpecError,
    /// Whether a violation is more than a number out of its range.
    pub is_misshapen: bool,
}

/// Checks `value` against the schema with this name, without violations that those `found` before
/// explain.
pub(crate) fn explain(
    components: &Components,
    name: &str,
    value: &Value,
    found: &SpecError,
) -> Explained {
    let known = found.violations.iter().map(|violation| parent_of(&violation.field)).collect();
    let (path, explained) = (String::new(), Explained::default());
    let mut walk = Walk { components, known, path, explained };
    if let Some(schema) = components.get(name) {
        walk.value(schema, value);
    }
    walk.explained
}

/// The object that the field is in, or the field itself at the top.
fn parent_of(field: &str) -> &str {
    field.rsplit_once('.').map_or(field, |(parent, _)| parent)
}

/// A walk through a value and its schema. Its time is proportional to the value's size.
struct Walk<'a> {
    components: &'a Components,
    /// Objects with violations that were found before. They explain all other violations there.
    known: HashSet<&'a str>,
    /// The path of the current value.
    path: String,
    explained: Explained,
}

impl<'a> Walk<'a> {
    fn resolve(&self, mut schema: &'a Value) -> &'a Value {
        while let Some(named) = referred(schema).and_then(|name| self.components.get(name)) {
            schema = named;
        }
        schema
    }

    /// Whether a schema is the one with this name.
    fn is(&self, schema: &Value, name: &str) -> bool {
        self.components.get(name).is_some_and(|named| std::ptr::eq(named, schema))
    }

    /// Visits a field of the current value.
    fn in_field(&mut self, field: &str, visit: impl FnOnce(&mut Self)) {
        let length = self.path.len();
        if length > 0 {
            self.path.push('.');
        }
        self.path.push_str(field);
        visit(self);
        self.path.truncate(length);
    }

    /// Visits an item of the current list.
    fn in_item(&mut self, index: usize, visit: impl FnOnce(&mut Self)) {
        let length = self.path.len();
        // Writing to a text cannot fail.
        let _ = write!(self.path, "[{index}]");
        visit(self);
        self.path.truncate(length);
    }

    /// Refuses the current value. `describe` gives it as text, and what is allowed.
    fn refuse(&mut self, describe: impl FnOnce() -> (String, String)) {
        self.explained.is_misshapen = true;
        self.note(describe);
    }

    fn note(&mut self, describe: impl FnOnce() -> (String, String)) {
        if self.is_known() {
            return;
        }
        let Self { path, explained, .. } = self;
        explained.error.add_with(|| {
            let (value, allowed) = describe();
            Violation::new(path.as_str(), value, allowed)
        });
    }

    /// Whether a violation found before lies in the same object as the current value, or in one
    /// around it.
    fn is_known(&self) -> bool {
        if self.known.is_empty() {
            return false;
        }
        // No path in a violation is longer.
        let ends = self.path.match_indices(['.', '[']).map(|(end, _)| end);
        let mut ends = ends.chain([self.path.len()]).take_while(|end| *end <= FIELD_BYTES);
        ends.any(|end| self.known.contains(&self.path[..end]))
    }

    fn value(&mut self, schema: &'a Value, value: &Value) {
        let schema = self.resolve(schema);
        if self.is(schema, "RobotModel")
            && let Some(allowed) = allowed_for_misnamed(value)
        {
            return self.refuse(|| (shorten(value), allowed));
        }
        if let Some(Value::Array(choices)) = schema.get("oneOf") {
            return self.choice(schema, choices, value);
        }
        if !has_type(schema, value) {
            let components = self.components;
            return self.refuse(|| (shorten(value), allowed(components, schema)));
        }
        match value {
            Value::Object(fields) => self.object(schema, fields),
            Value::Array(items) => self.list(schema, value, items),
            Value::Number(_) => self.number(schema, value),
            Value::String(text) => self.text(schema, value, text),
            Value::Null | Value::Bool(_) => {}
        }
    }

    fn object(&mut self, schema: &'a Value, fields: &Map<String, Value>) {
        let Some(known) = schema.get("properties").and_then(Value::as_object) else {
            if let Some(each) = schema.get("additionalProperties").filter(|value| value.is_object())
            {
                for (field, value) in fields {
                    self.in_field(field, |walk| walk.value(each, value));
                }
            }
            return;
        };
        for (field, value) in fields {
            self.in_field(field, |walk| match known.get(field) {
                Some(schema) => walk.value(schema, value),
                None => {
                    let components = walk.components;
                    walk.refuse(|| (String::new(), unknown(components, known, field)));
                }
            });
        }
        for field in schema["required"].as_array().into_iter().flatten() {
            let Some(field) = field.as_str().filter(|field| !fields.contains_key(*field)) else {
                continue;
            };
            let schema = known.get(field).map(|schema| self.resolve(schema));
            let components = self.components;
            let words = || schema.map(|schema| allowed(components, schema)).unwrap_or_default();
            self.in_field(field, |walk| walk.refuse(|| ("missing".to_owned(), words())));
        }
    }

    fn list(&mut self, schema: &'a Value, list: &Value, items: &[Value]) {
        let bound = |keyword: &str| schema.get(keyword).and_then(Value::as_u64);
        let exact = bound("minItems").filter(|least| bound("maxItems") == Some(*least));
        if exact.is_some_and(|exact| exact != items.len() as u64) {
            let components = self.components;
            return self.refuse(|| (shorten(list), allowed(components, schema)));
        }
        let Some(each) = schema.get("items") else { return };
        for (i, item) in items.iter().enumerate() {
            self.in_item(i, |walk| walk.value(each, item));
        }
    }

    fn number(&mut self, schema: &Value, value: &Value) {
        let Some(number) = value.as_f64() else { return };
        let bound = |keyword: &str| schema.get(keyword).and_then(Value::as_f64);
        let is_inside = bound("minimum").is_none_or(|least| least <= number)
            && bound("maximum").is_none_or(|most| number <= most)
            && bound("exclusiveMaximum").is_none_or(|most| number < most);
        if !is_inside {
            self.note(|| (value.to_string(), range_of(schema)));
        }
    }

    fn text(&mut self, schema: &'a Value, value: &Value, text: &str) {
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
        let components = self.components;
        self.refuse(|| {
            let names = names.into_iter().flatten().filter_map(Value::as_str);
            let mut words = allowed(components, schema);
            if let Some(meant) = nearest(text, names) {
                words = format!("{words}; did you mean `{meant}`?");
            }
            (shorten(value), words)
        });
    }

    /// Checks one of several forms. They differ by a tag, by their only field, or by their types.
    fn choice(&mut self, schema: &'a Value, choices: &'a [Value], value: &Value) {
        let choices: Vec<&'a Value> = choices.iter().map(|choice| self.resolve(choice)).collect();
        if let (Value::Object(fields), Some(tag)) = (value, tag_of(&choices)) {
            return self.tagged(&choices, tag, fields, value);
        }
        let fits = |choice: &&Value| match (value, only_field(choice)) {
            (Value::Object(fields), Some(field)) => fields.contains_key(field),
            _ => has_type(choice, value),
        };
        let misses_name = |choice: &Value| {
            let names = choice.get("enum").and_then(Value::as_array);
            names.is_some_and(|names| !names.contains(value))
        };
        let components = self.components;
        match choices.iter().copied().find(|choice| fits(choice) && !misses_name(choice)) {
            Some(choice) => self.value(choice, value),
            None => self.refuse(|| (shorten(value), allowed(components, schema))),
        }
    }

    fn tagged(
        &mut self,
        choices: &[&'a Value],
        tag: &str,
        fields: &Map<String, Value>,
        value: &Value,
    ) {
        let label = |&choice: &&'a Value| label_of(choice, tag);
        let given = fields.get(tag);
        let given_label = given.and_then(Value::as_str);
        let mut chosen = choices.iter().filter(|choice| label(choice) == given_label);
        if let (Some(_), Some(&chosen)) = (given_label, chosen.next()) {
            return self.value(chosen, value);
        }
        let labels = || choices.iter().filter_map(label).map(str::to_owned).collect::<Vec<_>>();
        self.in_field(tag, |walk| match given {
            None => walk.refuse(|| ("missing".to_owned(), labels().join(", "))),
            Some(given) => walk.refuse(|| {
                let labels = labels();
                let text = given.as_str().unwrap_or_default();
                let meant = nearest(text, labels.iter().map(String::as_str));
                (shorten(given), listed(&labels, meant))
            }),
        });
    }
}

/// Names that others give to fields.
const OTHER_NAMES: [(&str, &str); 4] =
    [("lr", "learning_rate"), ("wd", "weight_decay"), ("q", "y"), ("tau", "u")];

/// Labels of a job, and the parameters that have them.
const LABELS: [(&str, &str); 4] =
    [("name", "name"), ("note", "note"), ("tag", "tag"), ("tags", "tag")];

fn unknown(components: &Components, known: &Map<String, Value>, field: &str) -> String {
    let label = LABELS.iter().find(|(label, _)| *label == field);
    if let Some((_, parameter)) = label.filter(|_| is_job(known)) {
        return format!(
            "unknown field; it is a label, which is not part of a spec: submit with \
             `?{parameter}=...` or `--{parameter} ...`"
        );
    }
    let other = OTHER_NAMES.iter().find(|(other, _)| *other == field);
    let name = other.map_or(field, |(_, name)| name);
    if let Some(meant) = nearest(name, known.keys().map(String::as_str)) {
        return format!("unknown field; did you mean `{meant}`?");
    }
    match paths_to(components, known, name).as_slice() {
        paths @ ([_] | [_, _] | [_, _, _]) => {
            format!("unknown field; did you mean `{}`?", paths.join("` or `"))
        }
        _ => {
            let names: Vec<&str> = known.keys().map(String::as_str).collect();
            format!("unknown field; known here: {}", names.join(", "))
        }
    }
}

/// Whether these are the fields of a job that can be submitted.
fn is_job(known: &Map<String, Value>) -> bool {
    known.contains_key("execution")
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
