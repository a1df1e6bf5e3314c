//! References to robots that a server keeps. They stand in a spec where a description could stand, and
//! the server replaces them before it reads the spec.

use std::fmt;

use serde_json::Value;

use super::built_in::RobotModel;
use crate::error::without_middle;
use crate::{Digest, FIELD_BYTES, SpecError, Violation};

/// Largest number of references in one spec.
pub const MAX_ROBOT_REFERENCES: usize = 1000;

/// A robot that a server keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RobotReference {
    /// By its id: `{"robot": 7}`.
    Id(i64),
    /// By the digest of its description: `{"digest": "3f41…"}`.
    Digest(Digest),
}

impl fmt::Display for RobotReference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Id(id) => id.fmt(f),
            Self::Digest(digest) => digest.fmt(f),
        }
    }
}

/// A reference in a spec.
#[derive(Debug)]
pub struct NamedRobot<'a> {
    /// Path of the id or the digest, as in violations.
    pub field: String,
    /// The robot.
    pub robot: RobotReference,
    /// The place for its description.
    pub place: &'a mut Value,
}

/// A part of a field's path.
enum Step<'a> {
    Field(&'a str),
    Item(usize),
}

/// The references in a spec as it was sent: each field `model` of an object `robot`, wherever it is.
///
/// # Errors
/// There are more than [`MAX_ROBOT_REFERENCES`], or one is neither an id nor a digest.
pub fn named_robots(spec: &mut Value) -> Result<Vec<NamedRobot<'_>>, SpecError> {
    let mut places = Vec::new();
    find(spec, &mut Vec::new(), &mut places);
    if places.len() > MAX_ROBOT_REFERENCES {
        let found = format!("{} references to robots", places.len());
        let allowed = format!("{MAX_ROBOT_REFERENCES} at most");
        return Err(SpecError::one(&places[0].0, found, allowed));
    }
    let mut refused = SpecError::default();
    let mut named = Vec::with_capacity(places.len());
    for (field, place) in places {
        match read(place) {
            Ok((name, robot)) => {
                named.push(NamedRobot { field: format!("{field}.{name}"), robot, place });
            }
            Err(violation) => refused.append(SpecError::from(violation).within(&field)),
        }
    }
    refused.into_result()?;
    Ok(named)
}

/// Refuses references to robots where no server can look them up.
pub(crate) fn refuse_named_robots(spec: &mut Value) -> Result<(), SpecError> {
    let mut refused = SpecError::default();
    for NamedRobot { field, robot, .. } in named_robots(spec)? {
        let allowed = "the name of a built-in robot, or a description in place; a robot of a server \
                       can only be named in specs that are submitted to that server";
        refused.append(SpecError::one(field, robot.to_string(), allowed));
    }
    refused.into_result()
}

/// Finds the places of references, at most one above the limit. Their paths are as short as in
/// violations.
fn find<'a>(
    value: &'a mut Value,
    path: &mut Vec<Step<'a>>,
    found: &mut Vec<(String, &'a mut Value)>,
) {
    match value {
        Value::Object(fields) => {
            let is_robot = matches!(path.last(), Some(Step::Field("robot")));
            for (name, child) in fields {
                path.push(Step::Field(name));
                if is_robot && name == "model" && is_reference(child) {
                    if found.len() <= MAX_ROBOT_REFERENCES {
                        found.push((written(path), child));
                    }
                } else {
                    find(child, path, found);
                }
                path.pop();
            }
        }
        Value::Array(items) => {
            for (index, child) in items.iter_mut().enumerate() {
                path.push(Step::Item(index));
                find(child, path, found);
                path.pop();
            }
        }
        _ => {}
    }
}

/// Whether a value is a reference and no description, which has several fields.
fn is_reference(value: &Value) -> bool {
    let Some(fields) = value.as_object().filter(|fields| fields.len() == 1) else { return false };
    fields.contains_key("robot") || fields.contains_key("digest")
}

/// The allowed values of a `robot.model`, in words, for one that is neither a reference nor a
/// description: a name that is not built in, or an object with only a name or an id.
pub(crate) fn allowed_for_misnamed(model: &Value) -> Option<String> {
    let is_misnamed = match model {
        Value::String(name) => RobotModel::named(name).is_none(),
        Value::Object(fields) if fields.len() == 1 => {
            fields.contains_key("name") || fields.contains_key("id")
        }
        _ => false,
    };
    is_misnamed.then(|| {
        let built_in: Vec<String> = RobotModel::names().map(|name| format!("{name:?}")).collect();
        format!(
            "{}, a description, or a robot that the server keeps as {{\"robot\": ID}} or {{\"digest\": HEX}}; \
             `torqued robot list` has their ids",
            built_in.join(", ")
        )
    })
}

/// The name of the reference's field, and the robot.
fn read(reference: &Value) -> Result<(&'static str, RobotReference), Violation> {
    if let Some(id) = reference.get("robot") {
        let known = id.as_i64().filter(|id| *id > 0).map(RobotReference::Id);
        let allowed = "the id of a robot, a whole number from 1 on";
        return known
            .map(|robot| ("robot", robot))
            .ok_or_else(|| Violation::new("robot", id.to_string(), allowed));
    }
    let digest = &reference["digest"];
    let known = digest.as_str().and_then(|digest| digest.parse().ok()).map(RobotReference::Digest);
    let allowed = "the digest of a robot, 64 hexadecimal digits of a SHA-256";
    known
        .map(|robot| ("digest", robot))
        .ok_or_else(|| Violation::new("digest", digest.to_string(), allowed))
}

fn written(path: &[Step<'_>]) -> String {
    let mut text = String::new();
    for step in path {
        match step {
            Step::Field(name) if text.is_empty() => text.push_str(name),
            Step::Field(name) => text.extend([".", name]),
            Step::Item(index) => text.push_str(&format!("[{index}]")),
        }
        // A name may be as long as the spec.
        if text.len() > 4 * FIELD_BYTES {
            text = without_middle(text, FIELD_BYTES);
        }
    }
    without_middle(text, FIELD_BYTES)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn references_are_found_wherever_a_spec_has_a_robot() {
        let digest = Digest::of(b"arm");
        let mut spec = json!({
            "kind": "pipeline",
            "jobs": {
                "data": {"kind": "simulate", "robot": {"model": {"robot": 7}, "gravity": "on"}},
                "train": {"data": {"stream": {"robot": {"model": {"digest": digest}}}}},
                "other": {"robot": {"model": "panda"}},
                "described": {"robot": {"model": {"name": "arm", "joints": []}}},
                "by-name": {"data": {"digest": digest}},
            },
            "list": [{"robot": {"model": {"robot": 8}}}],
        });
        let named = named_robots(&mut spec).unwrap();
        let mut found: Vec<(String, RobotReference)> =
            named.iter().map(|named| (named.field.clone(), named.robot)).collect();
        found.sort();
        let expected = [
            ("jobs.data.robot.model.robot".to_owned(), RobotReference::Id(7)),
            (
                "jobs.train.data.stream.robot.model.digest".to_owned(),
                RobotReference::Digest(digest),
            ),
            ("list[0].robot.model.robot".to_owned(), RobotReference::Id(8)),
        ];
        assert_eq!(found, expected);
        for named in named {
            *named.place = json!("panda");
        }
        assert_eq!(spec["jobs"]["data"]["robot"]["model"], "panda");
        assert!(named_robots(&mut spec).unwrap().is_empty());
    }

    #[test]
    fn what_is_no_reference_is_named_with_what_is_allowed() {
        for (wrong, expected) in [
            (json!({"robot": 0}), "robot.model.robot is 0, allowed: the id of a robot"),
            (json!({"robot": "7"}), "robot.model.robot is \"7\", allowed: the id of a robot"),
            (json!({"digest": "3f41"}), "robot.model.digest is \"3f41\", allowed: the digest"),
        ] {
            let mut spec = json!({"robot": {"model": wrong}});
            let error = named_robots(&mut spec).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        let job = json!({"robot": {"model": {"robot": 1}}});
        let mut many = Value::from(vec![job; MAX_ROBOT_REFERENCES + 1]);
        let error = named_robots(&mut many).unwrap_err().to_string();
        assert!(error.contains("1001 references to robots, allowed: 1000 at most"), "{error}");
    }

    #[test]
    fn a_spec_without_a_server_names_no_robot_of_one() {
        let text = br#"{"kind": "simulate", "trajectories": 4, "excitation": {"chirp": {}},
                        "robot": {"model": {"robot": 7}}}"#;
        let error = crate::parse(text).unwrap_err().to_string();
        let expected = "robot.model.robot is 7, allowed: the name of a built-in robot";
        assert!(error.contains(expected) && error.contains("submitted to that server"), "{error}");
    }

    #[test]
    fn long_names_cost_no_more_than_short_ones() {
        let long = "x".repeat(1 << 20);
        let mut spec = json!({(long): {"robot": {"model": {"robot": 1}}}});
        let named = named_robots(&mut spec).unwrap();
        assert!(named[0].field.len() <= FIELD_BYTES + 20, "{}", named[0].field.len());
        assert!(named[0].field.ends_with(".robot.model.robot"), "{}", named[0].field);
    }
}
