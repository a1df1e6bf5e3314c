//! Runs a pipeline from submission to result, and compares results.

use std::collections::BTreeMap;
use std::time::Duration;

use reqwest::StatusCode;
use serde_json::Value;

use crate::product::{Product, member, small_pipeline};

/// The results of a pipeline without ids and times. They are equal for equal specs.
#[derive(Debug, PartialEq)]
pub struct Results {
    /// SHA-256 of every dataset file, by member and file name.
    files: BTreeMap<String, String>,
    /// SHA-256 of every file of the last checkpoint.
    checkpoint: BTreeMap<String, String>,
    report: Value,
}

/// Collects the results of a pipeline that succeeded.
pub async fn results(product: &Product, pipeline: &Value) -> Results {
    let mut files = BTreeMap::new();
    for name in ["train-set", "test-grid"] {
        let job = product.get(&format!("/v1/jobs/{}", member(pipeline, name))).await;
        let dataset = product.get(&format!("/v1/datasets/{}", job["dataset"])).await;
        let digests = digests(&dataset["files"]).into_iter();
        files.extend(digests.map(|(file, sha256)| (format!("{name}/{file}"), sha256)));
    }
    let training = product.get(&format!("/v1/jobs/{}", member(pipeline, "train"))).await;
    let last = training["checkpoints"].as_array().unwrap().iter().filter_map(Value::as_i64).max();
    let checkpoint = product.get(&format!("/v1/checkpoints/{}", last.unwrap())).await;
    let evaluation = member(pipeline, "evaluate");
    let evaluation = product.get(&format!("/v1/evaluations/{evaluation}")).await;
    Results {
        files,
        checkpoint: digests(&checkpoint["files"]),
        report: evaluation["report"].clone(),
    }
}

/// SHA-256 by name of a list of files.
fn digests(files: &Value) -> BTreeMap<String, String> {
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let files = files.as_array().unwrap();
    assert!(!files.is_empty());
    files.iter().map(|file| (text(&file["name"]), text(&file["sha256"]))).collect()
}

#[tokio::test]
async fn a_submitted_pipeline_ends_in_a_report_with_every_predictor_in_every_cell() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&small_pipeline()).await;
    let pipeline = product.succeeded(id).await;
    let report = results(&product, &pipeline).await.report;
    let names: Vec<&str> = report["predictors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|predictor| predictor["name"].as_str().unwrap())
        .collect();
    for name in ["hold-last", "damped-integrator", "least-squares", "robomorph"] {
        assert!(
            names.iter().any(|candidate| candidate.starts_with(name)),
            "{name} is not among {names:?}"
        );
    }
    let cells = report["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 3);
    for cell in cells {
        assert_eq!(cell["scenarios"], 20);
        assert_eq!(cell["in_distribution"], cell["frequency_hz"] == 0.15);
        assert_eq!(cell["rmse_deg"].as_array().unwrap().len(), names.len());
    }
}

#[tokio::test]
async fn the_same_spec_is_answered_with_the_job_that_exists_unless_forced() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let spec = small_pipeline();
    let first = product.submit(&spec).await;
    let first_job = product.succeeded(first).await;

    let (status, again) = product.post("/v1/jobs", spec.to_string()).await;
    assert_eq!((status, again["id"].as_i64()), (StatusCode::OK, Some(first)));

    let (status, forced) = product.post("/v1/jobs?force=true", spec.to_string()).await;
    assert_eq!(status, StatusCode::CREATED);
    let forced = product.succeeded(forced["id"].as_i64().unwrap()).await;
    assert_ne!(forced["id"], first_job["id"]);
    assert_eq!(results(&product, &forced).await, results(&product, &first_job).await);
}

#[tokio::test]
async fn a_cancelled_job_ends_cancelled_and_what_needs_it_never_runs() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = small_pipeline();
    spec["jobs"]["train"]["steps"] = 1_000_000.into();
    let id = product.submit(&spec).await;
    product
        .job_when(id, |job| {
            let members = job["members"].as_array().unwrap();
            members.iter().any(|member| member["name"] == "train" && member["state"] == "running")
        })
        .await;
    let (status, _) = product.post(&format!("/v1/jobs/{id}/cancel"), "").await;
    assert_eq!(status, StatusCode::OK);
    // Far longer than a heartbeat and a checkpoint take, and far shorter than reading to the last
    // step.
    let ended = tokio::time::timeout(Duration::from_secs(20), product.finished(id)).await;
    let pipeline = ended.expect("a cancelled training ends soon");
    assert_eq!(pipeline["state"], "cancelled", "{pipeline:#}");
    let evaluation = member(&pipeline, "evaluate");
    assert_eq!(product.finished(evaluation).await["state"], "cancelled");
}
