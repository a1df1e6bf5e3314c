//! Compares the pages on jobs with the OpenAPI document: each page names every field of its kind of
//! job.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::Value;

/// Fields that all jobs have.
const SHARED: [&str; 2] = ["kind", "execution"];
/// Its fields are in docs/queue.md.
const EXECUTION: &str = "Execution";

/// A schema, its pages, and its parts that have their own pages.
const PAGES: [(&str, &[&str], &[&str]); 5] = [
    ("SimulateJob", &["simulate.md", "closed-loop.md"], &["initial_state", "RobotDescription"]),
    ("TrainJob", &["training.md"], &["model", "data"]),
    ("EvaluateJob", &["evaluation.md"], &["data", "checkpoints", "baselines"]),
    ("ControlJob", &["control.md"], &["data", "checkpoints"]),
    ("ImportJob", &["import.md"], &["robot"]),
];

#[test]
fn a_page_names_every_field_of_its_job() {
    let document = read("api/openapi.json");
    let document: Value = serde_json::from_str(&document).unwrap();
    let mut missing = Vec::new();
    for (job, pages, elsewhere) in PAGES {
        let text: String = pages.iter().map(|page| read(&format!("docs/{page}"))).collect();
        let page = pages.join(" and ");
        let mut fields = BTreeSet::new();
        collect(&document, &document["components"]["schemas"][job], elsewhere, &mut fields);
        assert!(fields.len() > 5, "{job} has only {fields:?}");
        missing.extend(
            fields
                .into_iter()
                .filter(|field| !SHARED.contains(&field.as_str()) && !names(&text, field))
                .map(|field| format!("docs/{page}: {field}")),
        );
    }
    assert!(missing.is_empty(), "{missing:#?}");
}

/// Whether a page has the field as code, alone or as the last part of a path.
fn names(page: &str, field: &str) -> bool {
    page.split('`').skip(1).step_by(2).any(|code| {
        code.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == '-'))
            .any(|word| word == field)
    })
}

/// Collects all fields of a schema and of the schemas to which it refers, except those below
/// `elsewhere`.
fn collect(document: &Value, schema: &Value, elsewhere: &[&str], fields: &mut BTreeSet<String>) {
    match schema {
        Value::Object(members) => {
            if let Some(Value::String(reference)) = members.get("$ref") {
                let name = reference.rsplit('/').next().unwrap();
                if name != EXECUTION && !elsewhere.contains(&name) {
                    collect(document, &document["components"]["schemas"][name], elsewhere, fields);
                }
                return;
            }
            for (key, member) in members {
                if key != "properties" {
                    collect(document, member, elsewhere, fields);
                    continue;
                }
                for (field, inner) in member.as_object().unwrap() {
                    fields.insert(field.clone());
                    if !elsewhere.contains(&field.as_str()) {
                        collect(document, inner, elsewhere, fields);
                    }
                }
            }
        }
        Value::Array(items) => {
            items.iter().for_each(|item| collect(document, item, elsewhere, fields));
        }
        _ => {}
    }
}

fn read(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    fs::read_to_string(root.join(path)).unwrap()
}

#[test]
fn a_field_counts_when_it_stands_as_code() {
    assert!(names("the `robot.mass_fraction` of", "mass_fraction"));
    assert!(!names("the mass_fraction of `robot`", "mass_fraction"));
    assert!(!names("`mass_fractions`", "mass_fraction"));
}
