//! The smallest model of every architecture that learns, plain and with each of its options.
//!
//! `NAME.json` has the fields of the plain model and, for each option, the fields that it changes.

use std::fs;
use std::path::Path;

use serde_json::{Map, Value};
use spec::ModelSpec;

/// The models by name, such as `robomorph` and `robomorph, gaussian`.
pub fn models() -> Vec<(String, Value)> {
    ModelSpec::ARCHITECTURES.iter().flat_map(|architecture| of(architecture)).collect()
}

/// The model of [`models`] with this name.
pub fn model(name: &str) -> Value {
    let found = models().into_iter().find(|(model, _)| model == name);
    found.unwrap_or_else(|| panic!("no model is called {name:?}")).1
}

fn of(architecture: &str) -> Vec<(String, Value)> {
    // Tests of other crates include this file.
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/tests/smallest");
    let path = folder.join(format!("{architecture}.json"));
    let text = fs::read_to_string(&path).unwrap_or_else(|error| {
        panic!("{} should have the smallest {architecture} that learns: {error}", path.display())
    });
    let mut options: Map<String, Value> = serde_json::from_str(&text).unwrap();
    let plain = options.remove("plain").unwrap();
    let mut models = vec![(architecture.to_owned(), plain.clone())];
    for (option, changes) in options {
        let mut model = plain.clone();
        for (field, value) in changes.as_object().unwrap() {
            model[field] = value.clone();
        }
        models.push((format!("{architecture}, {option}"), model));
    }
    models
}
