//! The OpenAPI document is committed and complete, and the server complies with it.

use std::collections::BTreeSet;
use std::path::Path;

use axum::http::Method;
use serde_json::{Value, json};

use crate::fixture::{Server, small_pipeline, small_simulation};
use crate::{labels, resources, robots, uploads};

/// Writes the committed document anew if `UPDATE` is set.
#[test]
fn the_committed_document_is_the_generated_one() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("openapi.json");
    let generated = format!("{}\n", serde_json::to_string_pretty(&api::openapi()).unwrap());
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &generated).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        committed == generated,
        "api/openapi.json is not what the handlers say; run this test with UPDATE=1"
    );
}

/// Only real models answer these with success. The tests of `live` have them.
const PREDICT: &str = "/v1/checkpoints/{id}/predict";
const TORQUE: &str = "/v1/checkpoints/{id}/torque";
const PREDICTIONS: &str = "/v1/datasets/{id}/trajectories/{index}/predictions";
const STREAM: &str = "/v1/checkpoints/{id}/stream";

/// Every operation, with a request that succeeds.
const OPERATIONS: [(&str, &str, &str); 76] = [
    ("get", "/healthz", "/healthz"),
    ("get", "/readyz", "/readyz"),
    ("get", "/metrics", "/metrics"),
    ("get", "/v1/presets", "/v1/presets"),
    ("get", "/v1/workers", "/v1/workers"),
    ("post", "/v1/workers/{name}/drain", "/v1/workers/w1/drain"),
    ("post", "/v1/workers/{name}/undrain", "/v1/workers/w1/undrain"),
    ("get", "/v1/queue", "/v1/queue"),
    ("post", "/v1/queue/pause", "/v1/queue/pause"),
    ("post", "/v1/queue/resume", "/v1/queue/resume"),
    ("get", "/v1/tokens", "/v1/tokens"),
    ("get", "/v1/audit", "/v1/audit?actor=anyone"),
    ("post", "/v1/jobs", "/v1/jobs"),
    ("get", "/v1/jobs", "/v1/jobs"),
    ("get", "/v1/jobs/{id}", "/v1/jobs/5"),
    ("patch", "/v1/jobs/{id}", "/v1/jobs/5"),
    ("patch", "/v1/datasets/{id}", "/v1/datasets/1"),
    ("patch", "/v1/runs/{id}", "/v1/runs/1"),
    ("patch", "/v1/checkpoints/{id}", "/v1/checkpoints/1"),
    ("post", "/v1/jobs/{id}/cancel", "/v1/jobs/6/cancel"),
    ("post", "/v1/jobs/{id}/retry", "/v1/jobs/6/retry"),
    ("get", "/v1/jobs/{id}/tasks", "/v1/jobs/1/tasks"),
    ("get", "/v1/jobs/{id}/attempts", "/v1/jobs/1/attempts"),
    ("get", "/v1/jobs/{id}/logs", "/v1/jobs/1/logs"),
    ("get", "/v1/attempts/{id}/log", "/v1/attempts/1/log"),
    ("get", "/v1/events", "/v1/events"),
    ("get", "/v1/jobs/{id}/events", "/v1/jobs/1/events"),
    ("get", "/v1/runs/{id}/events", "/v1/runs/1/events"),
    ("get", "/v1/datasets", "/v1/datasets"),
    ("post", "/v1/datasets", "/v1/datasets"),
    ("get", "/v1/datasets/{id}", "/v1/datasets/1"),
    ("get", "/v1/datasets/{id}/files/{name}", "/v1/datasets/1/files/robots-00000.parquet"),
    ("get", "/v1/datasets/{id}/tar", "/v1/datasets/1/tar"),
    ("post", "/v1/datasets/{id}/verify", "/v1/datasets/1/verify"),
    ("get", "/v1/datasets/{id}/summary", "/v1/datasets/1/summary"),
    ("get", "/v1/datasets/{id}/spectrum.svg", "/v1/datasets/1/spectrum.svg"),
    ("get", "/v1/datasets/{id}/spectrum.csv", "/v1/datasets/1/spectrum.csv"),
    ("get", "/v1/datasets/{id}/trajectories/{index}", "/v1/datasets/1/trajectories/19"),
    (
        "get",
        "/v1/datasets/{id}/trajectories/{index}/figure.svg",
        "/v1/datasets/1/trajectories/0/figure.svg",
    ),
    (
        "get",
        "/v1/datasets/{id}/trajectories/{index}/figure.csv",
        "/v1/datasets/1/trajectories/0/figure.csv",
    ),
    ("get", PREDICTIONS, "/v1/datasets/1/trajectories/0/predictions?checkpoint=1"),
    ("get", "/v1/runs", "/v1/runs"),
    ("get", "/v1/runs/{id}", "/v1/runs/1"),
    ("get", "/v1/runs/{id}/metrics/{key}", "/v1/runs/1/metrics/train%2Floss"),
    ("get", "/v1/runs/{id}/metrics/{group}/{name}", "/v1/runs/1/metrics/train/loss"),
    ("get", "/v1/runs/{id}/artifacts/{name}", "/v1/runs/2/artifacts/report.json"),
    ("get", "/v1/runs/{id}/figures/{name}", "/v1/runs/1/figures/loss.csv"),
    ("get", "/v1/checkpoints", "/v1/checkpoints"),
    ("get", "/v1/checkpoints/{id}", "/v1/checkpoints/1"),
    ("get", "/v1/checkpoints/{id}/files/{name}", "/v1/checkpoints/1/files/config.json"),
    ("get", "/v1/checkpoints/{id}/tar", "/v1/checkpoints/1/tar"),
    ("post", PREDICT, "/v1/checkpoints/1/predict"),
    ("post", TORQUE, "/v1/checkpoints/1/torque"),
    ("get", STREAM, "/v1/checkpoints/1/stream"),
    ("post", "/v1/robots", "/v1/robots"),
    ("get", "/v1/robots", "/v1/robots"),
    ("get", "/v1/robots/{id}", "/v1/robots/1"),
    ("get", "/v1/robots/{id}/{name}", "/v1/robots/1/arm.urdf"),
    ("delete", "/v1/robots/{id}", "/v1/robots/1"),
    ("get", "/v1/evaluations", "/v1/evaluations"),
    ("get", "/v1/evaluations/{id}", "/v1/evaluations/4"),
    ("get", "/v1/jobs/{id}/dependents", "/v1/jobs/4/dependents"),
    ("get", "/v1/runs/{id}/dependents", "/v1/runs/2/dependents"),
    ("get", "/v1/datasets/{id}/dependents", "/v1/datasets/2/dependents"),
    ("get", "/v1/checkpoints/{id}/dependents", "/v1/checkpoints/1/dependents"),
    ("delete", "/v1/datasets/{id}", "/v1/datasets/2?force=true"),
    ("post", "/v1/datasets/{id}/restore", "/v1/datasets/2/restore"),
    ("delete", "/v1/checkpoints/{id}", "/v1/checkpoints/1?force=true"),
    ("post", "/v1/checkpoints/{id}/restore", "/v1/checkpoints/1/restore"),
    ("delete", "/v1/runs/{id}", "/v1/runs/2?force=true"),
    ("post", "/v1/runs/{id}/restore", "/v1/runs/2/restore"),
    ("delete", "/v1/jobs/{id}", "/v1/jobs/4?force=true"),
    ("post", "/v1/jobs/{id}/restore", "/v1/jobs/4/restore"),
    ("get", "/v1/trash", "/v1/trash"),
    // These come last, because the server requires a token from the first one on.
    ("delete", "/v1/tokens/{id}", "/v1/tokens/1"),
    ("post", "/v1/tokens", "/v1/tokens"),
];

#[tokio::test]
async fn every_documented_operation_answers_and_every_one_is_listed_here() {
    let server = Server::start().await;
    server.submitted(&small_pipeline()).await;
    server.work().await;
    server.submitted(&small_simulation(7)).await;
    server.store.register_worker(&resources::worker()).await.unwrap();

    let document = server.json("/v1/openapi.json").await;
    let mut documented: BTreeSet<(String, String)> = BTreeSet::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for method in item.as_object().unwrap().keys() {
            documented.insert((method.clone(), path.clone()));
        }
    }
    for (method, path, request) in OPERATIONS {
        assert!(documented.remove(&(method.to_owned(), path.to_owned())), "{method} {path}");
        if [PREDICT, PREDICTIONS, TORQUE, STREAM].contains(&path) {
            continue;
        }
        let answer = match method {
            "post" if path == "/v1/jobs" => server.submit(&small_simulation(8)).await,
            "post" if path == "/v1/datasets" => uploads::send_recordings(&server).await,
            "post" if path == "/v1/robots" => robots::send_urdf(&server).await,
            "patch" => labels::patch(&server, request, &json!({"tags": ["a"]})).await,
            "delete" | "post" if path.starts_with("/v1/tokens") => continue,
            "post" => server.request(Method::POST, request, &[]).await,
            "delete" => server.request(Method::DELETE, request, &[]).await,
            _ => server.get(request).await,
        };
        assert!(answer.status.is_success(), "{method} {request}: {answer:?}");
    }
    assert!(documented.is_empty(), "documented but not listed here: {documented:?}");
}

#[tokio::test]
async fn no_documented_operation_answers_without_the_token() {
    let options = api::Options { token: Some("secret".to_owned()), ..api::Options::default() };
    let server = Server::start_with(&options).await;
    for (method, path, request) in OPERATIONS {
        if ["/healthz", "/readyz"].contains(&path) {
            continue;
        }
        let method = Method::from_bytes(method.to_uppercase().as_bytes()).unwrap();
        server.request(method, request, &[]).await.problem(401);
    }
}

/// Collects every `$ref` of a document.
fn references(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => {
            if let Some(Value::String(reference)) = fields.get("$ref") {
                found.insert(reference.clone());
            }
            fields.values().for_each(|value| references(value, found));
        }
        Value::Array(items) => items.iter().for_each(|value| references(value, found)),
        _ => {}
    }
}

#[tokio::test]
async fn the_document_refers_to_nothing_that_it_lacks() {
    let document = Server::start().await.json("/v1/openapi.json").await;
    assert!(document["openapi"].as_str().unwrap().starts_with("3.1"));
    let paths = document["paths"].as_object().unwrap().values();
    let operations: Vec<&Value> =
        paths.flat_map(|item| item.as_object().unwrap().values()).collect();
    let names: BTreeSet<&str> =
        operations.iter().map(|operation| operation["operationId"].as_str().unwrap()).collect();
    assert_eq!(names.len(), operations.len(), "each operation has a name of its own");
    let mut found = BTreeSet::new();
    references(&document, &mut found);
    assert!(found.contains("#/components/schemas/Job"));
    for reference in found {
        assert!(document.pointer(&reference[1..]).is_some(), "{reference}");
    }
}
