//! Compares every request and answer of these tests with the committed OpenAPI document.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex};

use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, Method};
use jsonschema::Validator;
use serde_json::{Value, json};

use crate::fixture::TestResponse;

static DOCUMENT: LazyLock<Value> = LazyLock::new(|| {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi.json");
    let text = std::fs::read(path).expect("the committed document");
    serde_json::from_slice(&text).expect("the committed document is JSON")
});

/// A request, with the parts that the document describes.
pub struct Asked {
    pub method: Method,
    pub path: String,
    pub query: String,
    pub content_type: String,
    /// The body, if it is JSON.
    pub json: Option<Value>,
}

impl Asked {
    pub fn new(parts: &axum::http::request::Parts, body: Option<&[u8]>) -> Self {
        Self {
            method: parts.method.clone(),
            path: parts.uri.path().to_owned(),
            query: parts.uri.query().unwrap_or_default().to_owned(),
            content_type: media_type(&parts.headers),
            json: body.and_then(|body| serde_json::from_slice(body).ok()),
        }
    }

    /// Fails if the answer differs from the document, or the request does although it was accepted.
    #[track_caller]
    pub fn check(&self, answer: &TestResponse) {
        let Some((place, operation)) = self.operation() else { return };
        let name = format!("{} {}", self.method, self.path);
        let status = answer.status.as_u16().to_string();
        let response = operation["responses"].get(&status);
        let response = response.unwrap_or_else(|| panic!("{name}: {status} is not documented"));
        if !answer.body.is_empty() && self.method != Method::HEAD {
            let found = media_type(&answer.headers);
            let content = response["content"].get(&found);
            let content = content.unwrap_or_else(|| panic!("{name}: {status} has {found}"));
            // The document does not describe the JSON in files.
            let is_described = content["schema"] != json!({});
            if found.ends_with("json") && is_described {
                let place = format!("{place}/responses/{status}/content/{}", escaped(&found));
                let body = serde_json::from_slice(&answer.body);
                let body = body.unwrap_or_else(|error| panic!("{name}: {error}"));
                check(&place, content, &body, &format!("the answer {status} of {name}"));
            }
        }
        if answer.status.is_success() {
            self.check_request(&place, operation, &name);
        }
    }

    #[track_caller]
    fn check_request(&self, place: &str, operation: &Value, name: &str) {
        for pair in self.query.split('&').filter(|pair| !pair.is_empty()) {
            let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
            let parameters = operation["parameters"].as_array().into_iter().flatten();
            let mut of_query =
                parameters.enumerate().filter(|(_, parameter)| parameter["in"] == "query");
            let (i, parameter) = of_query
                .find(|(_, parameter)| parameter["name"] == key)
                .unwrap_or_else(|| panic!("{name}: {key} is not documented"));
            if let Ok(value @ (Value::Number(_) | Value::Bool(_))) = serde_json::from_str(value) {
                let schema = parameter["schema"].to_string();
                let value =
                    if schema.contains("string") { value.to_string().into() } else { value };
                // A parameter that may be repeated is a list.
                let value = if schema.contains("array") { json!([value]) } else { value };
                check(
                    &format!("{place}/parameters/{i}"),
                    parameter,
                    &value,
                    &format!("{key} of {name}"),
                );
            }
        }
        if let Some(json) = &self.json {
            let contents = &operation["requestBody"]["content"];
            let content = contents.get(&self.content_type);
            let content = content
                .unwrap_or_else(|| panic!("{name}: {} is not documented", self.content_type));
            let place = format!("{place}/requestBody/content/{}", escaped(&self.content_type));
            check(&place, content, json, &format!("the body of {name}"));
        }
    }

    /// The operation that answers, and its place in the document.
    fn operation(&self) -> Option<(String, &'static Value)> {
        let method = match self.method {
            Method::HEAD => "get".to_owned(),
            ref other => other.as_str().to_lowercase(),
        };
        let paths = DOCUMENT["paths"].as_object()?;
        let fitting = paths.iter().filter(|(path, _)| is_path(path, &self.path));
        // A path with fewer variables is more specific.
        let (path, item) = fitting.min_by_key(|(path, _)| path.matches('{').count())?;
        Some((format!("/paths/{}/{method}", escaped(path)), item.get(&method)?))
    }
}

fn is_path(template: &str, path: &str) -> bool {
    let (template, path) = (template.split('/'), path.split('/'));
    template.clone().count() == path.clone().count()
        && template
            .zip(path)
            .all(|(known, found)| known == found || known.starts_with('{') && !found.is_empty())
}

fn media_type(headers: &HeaderMap) -> String {
    let value = headers.get(CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    value.split(';').next().unwrap_or_default().trim().to_lowercase()
}

/// The text as part of a JSON pointer.
fn escaped(text: &str) -> String {
    text.replace('~', "~0").replace('/', "~1")
}

/// Fails if `value` does not match the schema of `holder`, which is at `place` in the document.
#[track_caller]
fn check(place: &str, holder: &Value, value: &Value, what: &str) {
    let validator = validator(place, &holder["schema"]);
    let errors: Vec<String> = validator
        .iter_errors(value)
        .map(|error| format!("{}: {error}", error.instance_path()))
        .collect();
    assert!(errors.is_empty(), "{what} contradicts the document: {errors:#?}\n{value:#}");
}

/// Fails if the data of a server-sent event does not match the document.
#[track_caller]
pub fn check_event(data: &Value) {
    let holder = json!({"schema": {"$ref": "#/components/schemas/Event"}});
    check("/components/schemas/Event", &holder, data, "an event");
}

/// The validator of a schema, made once.
fn validator(place: &str, schema: &Value) -> Arc<Validator> {
    static MADE: LazyLock<Mutex<HashMap<String, Arc<Validator>>>> = LazyLock::new(Mutex::default);
    let mut made = MADE.lock().expect("no test fails while it makes a validator");
    let make = || {
        let mut root = json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "components": DOCUMENT["components"],
        });
        root["allOf"] = json!([schema]);
        Arc::new(jsonschema::validator_for(&root).expect("a schema of the document is one"))
    };
    made.entry(place.to_owned()).or_insert_with(make).clone()
}

#[test]
fn a_wrong_answer_would_be_found() {
    let document = &DOCUMENT["components"]["schemas"];
    let job = validator("test", &json!({"$ref": "#/components/schemas/SubmittedJob"}));
    assert!(document["SubmittedJob"]["oneOf"].as_array().is_some_and(|schemas| schemas.len() > 7));
    for accepted in [
        json!({"preset": "quickstart", "jobs": {"train": {"steps": 10}}}),
        json!({"preset": "D1-chirp", "trajectories": 10}),
        json!({"kind": "train", "data": {"dataset": 1}, "steps": 1, "model": {"preset": "cdt-tiny"}}),
        json!({"kind": "evaluate"}),
    ] {
        let errors: Vec<String> =
            job.iter_errors(&accepted).map(|error| error.to_string()).collect();
        assert!(errors.is_empty(), "{accepted}: {errors:?}");
    }
    for refused in [
        json!({"preset": "quickstart", "jobs": {"train": {"stesp": 10}}}),
        json!({"preset": "D1-chirp", "trajectories": 0}),
        json!({"kind": "train", "data": {"dataset": 1}, "steps": 0, "model": {"preset": "cdt-tiny"}}),
        json!({"kind": "simulate", "trajectories": 10}),
        json!({"trajectories": 10}),
    ] {
        assert!(!job.is_valid(&refused), "{refused}");
    }
}
