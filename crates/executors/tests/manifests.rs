//! The manifests in `deploy/kubernetes`. Kubernetes must know every field of every document, and
//! the server's role must allow exactly what the server does.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::time::Duration;

use executors::{Kubernetes, WorkerCommand};
use k8s_openapi::api::apps::v1::Deployment;
use k8s_openapi::api::batch::v1::Job;
use k8s_openapi::api::core::v1::{Service, ServiceAccount};
use k8s_openapi::api::rbac::v1::{Role, RoleBinding};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/kubernetes")
}

fn text(name: &str) -> String {
    std::fs::read_to_string(folder().join(name)).unwrap()
}

fn documents(name: &str) -> Vec<Value> {
    serde_saphyr::from_multiple(&text(name)).unwrap()
}

fn document(name: &str, kind: &str) -> Value {
    let documents = documents(name);
    documents.into_iter().find(|document| document["kind"] == kind).unwrap()
}

/// Fields of `written` that Kubernetes' types do not have.
fn unknown(written: &Value, read: &Value, place: &str) -> Vec<String> {
    match (written, read) {
        (Value::Object(written), Value::Object(read)) => written
            .iter()
            .flat_map(|(name, value)| {
                let place = format!("{place}.{name}");
                match read.get(name) {
                    Some(read) => unknown(value, read, &place),
                    None if *value == json!({}) => Vec::new(),
                    None => vec![place],
                }
            })
            .collect(),
        (Value::Array(written), Value::Array(read)) if written.len() == read.len() => {
            let pairs = written.iter().zip(read).enumerate();
            pairs
                .flat_map(|(index, (written, read))| {
                    unknown(written, read, &format!("{place}[{index}]"))
                })
                .collect()
        }
        _ if written == read => Vec::new(),
        _ => vec![format!("{place} is {written}, read as {read}")],
    }
}

fn check<K: DeserializeOwned + Serialize>(document: &Value) {
    let read: K = serde_json::from_value(document.clone()).unwrap();
    let read = serde_json::to_value(read).unwrap();
    let unknown = unknown(document, &read, document["kind"].as_str().unwrap());
    assert!(unknown.is_empty(), "{unknown:#?}");
}

#[test]
fn every_document_is_what_kubernetes_understands() {
    let mut kinds = Vec::new();
    let files = ["server.yaml", "worker.yaml", "migration.yaml"];
    for document in &files.map(documents).concat() {
        let (version, kind) = (&document["apiVersion"], document["kind"].as_str().unwrap());
        match (version.as_str().unwrap(), kind) {
            ("v1", "ServiceAccount") => check::<ServiceAccount>(document),
            ("v1", "Service") => check::<Service>(document),
            ("rbac.authorization.k8s.io/v1", "Role") => check::<Role>(document),
            ("rbac.authorization.k8s.io/v1", "RoleBinding") => check::<RoleBinding>(document),
            ("apps/v1", "Deployment") => check::<Deployment>(document),
            ("batch/v1", "Job") => check::<Job>(document),
            other => panic!("an unknown kind: {other:?}"),
        }
        kinds.push(kind.to_owned());
    }
    let expected = ["ServiceAccount", "Role", "RoleBinding", "Service", "Deployment", "Job", "Job"];
    assert_eq!(kinds, expected);
}

#[test]
fn a_field_that_kubernetes_does_not_have_is_noticed() {
    let mut job = document("worker.yaml", "Job");
    job["spec"]["template"]["spec"]["containers"][0]["comand"] = json!(["torqued"]);
    let read: Job = serde_json::from_value(job.clone()).unwrap();
    let read = serde_json::to_value(read).unwrap();
    assert_eq!(unknown(&job, &read, "Job"), ["Job.spec.template.spec.containers[0].comand"]);
}

#[test]
fn names_refer_to_what_is_there() {
    let kustomization = document("kustomization.yaml", "Kustomization");
    let generated = &kustomization["configMapGenerator"][0];
    let files = [&kustomization["resources"][0], &generated["files"][0]];
    assert!(files.iter().all(|file| folder().join(file.as_str().unwrap()).is_file()));
    let deployment = document("server.yaml", "Deployment");
    let pod = &deployment["spec"]["template"];
    let volumes = pod["spec"]["volumes"].as_array().unwrap();
    assert!(volumes.iter().any(|volume| volume["configMap"]["name"] == generated["name"]));
    for mount in pod["spec"]["containers"][0]["volumeMounts"].as_array().unwrap() {
        assert!(volumes.iter().any(|volume| volume["name"] == mount["name"]), "{mount}");
    }
    assert_eq!(pod["metadata"]["labels"], deployment["spec"]["selector"]["matchLabels"]);
    assert_eq!(document("server.yaml", "Service")["spec"]["selector"], pod["metadata"]["labels"]);
    let account = &document("server.yaml", "ServiceAccount")["metadata"]["name"];
    assert_eq!(pod["spec"]["serviceAccountName"], *account);
    let binding = document("server.yaml", "RoleBinding");
    assert_eq!(binding["subjects"][0]["name"], *account);
    assert_eq!(binding["roleRef"]["name"], document("server.yaml", "Role")["metadata"]["name"]);
}

/// The engine's test compares the actual requests with the same list.
#[test]
fn the_role_allows_what_the_server_does_and_no_more() {
    let expected = json!([
        {"apiGroups": ["batch"], "resources": ["jobs"], "verbs": ["create", "delete", "list"]},
        {"apiGroups": [""], "resources": ["pods"], "verbs": ["list"]},
    ]);
    assert_eq!(document("server.yaml", "Role")["rules"], expected);
}

#[tokio::test]
async fn the_workers_job_is_one_that_workers_are_made_from() {
    let command = WorkerCommand {
        program: "torqued".into(),
        store: Vec::new(),
        device: "cpu".to_owned(),
        gpu_device: "cuda".to_owned(),
        lease_seconds: 15,
        log: "info".to_owned(),
        idle_exit: Duration::from_secs(300),
        environment: Vec::new(),
    };
    let config = kube::Config::new("http://127.0.0.1:1".parse().unwrap());
    Kubernetes::with_config("ab".to_owned(), command, &text("worker.yaml"), config).unwrap();
    let job = document("worker.yaml", "Job");
    let image = document("kustomization.yaml", "Kustomization")["images"][0].clone();
    let (name, tag) = (image["newName"].as_str().unwrap(), image["newTag"].as_str().unwrap());
    for job in [job, document("migration.yaml", "Job")] {
        let containers = &job["spec"]["template"]["spec"]["containers"];
        assert_eq!(containers[0]["image"], format!("{name}:{tag}"));
    }
}
