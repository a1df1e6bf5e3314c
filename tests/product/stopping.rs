//! One Ctrl-C releases all tasks in order, and the next start continues them.

use std::time::Duration;

use crate::pipeline::results;
use crate::product::{Product, is_alive, member, small_pipeline};

/// "Within seconds", on a busy machine.
const SECONDS: Duration = Duration::from_secs(15);

#[tokio::test]
async fn ctrl_c_ends_within_seconds_and_the_next_start_resumes_to_the_same_result() {
    let undisturbed_data = tempfile::tempdir().unwrap();
    let undisturbed = Product::start(undisturbed_data.path());
    let id = undisturbed.submit(&long_training()).await;
    let pipeline = undisturbed.succeeded(id).await;
    let expected = results(&undisturbed, &pipeline).await;
    drop(undisturbed);

    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&long_training()).await;
    let training = member(&product.get(&format!("/v1/jobs/{id}")).await, "train");
    product.job_when(training, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
    let workers = product.workers();
    let (code, took) = product.end_by("INT");
    assert_eq!(code, Some(0));
    assert!(took < SECONDS, "took {took:?}");
    assert!(!workers.iter().any(|pid| is_alive(*pid)), "a worker outlived its server");

    let product = Product::start(data.path());
    let tasks = product.get(&format!("/v1/jobs/{training}/tasks")).await;
    assert_eq!(tasks["tasks"][0]["error"], serde_json::Value::Null, "{tasks:#}");
    let pipeline = product.succeeded(id).await;
    assert_eq!(results(&product, &pipeline).await, expected);
}

#[tokio::test]
async fn an_idle_server_ends_at_once_by_sigterm() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    product.get("/healthz").await;
    let (code, took) = product.end_by("TERM");
    assert_eq!(code, Some(0));
    assert!(took < SECONDS, "took {took:?}");
}

fn long_training() -> serde_json::Value {
    let mut spec = small_pipeline();
    spec["jobs"]["train"]["steps"] = 600.into();
    spec
}
