//! A worker without a server: it ends when it finds nothing to do, and releases its task even if it
//! is told to end twice.

use std::process::Command;

use serde_json::{Value, json};

use crate::product::{Product, run_to_end, signal, small_pipeline, torqued};

fn worker(data: &std::path::Path, arguments: &[&str]) -> Command {
    let mut command = torqued(&["worker", "--name", "lone", "--threads", "1", "--data"]);
    command.arg(data).args(arguments);
    command
}

#[tokio::test]
async fn a_worker_ends_when_it_found_no_task_for_long_enough() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let id = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    let (code, _, errors) = run_to_end(&mut worker(data.path(), &["--idle-exit", "1"]));
    assert_eq!(code, Some(0), "{errors}");
    assert!(errors.contains("it found no task for 1 s"), "{errors}");
    assert_eq!(product.get(&format!("/v1/jobs/{id}")).await["state"], "succeeded");
    assert_eq!(product.get("/v1/workers").await["workers"], json!([]));
}

/// Slurm sends SIGTERM some time before a worker's end, and again at its end.
#[tokio::test]
async fn a_worker_that_is_told_twice_to_end_puts_its_task_down_all_the_same() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let mut spec = small_pipeline()["jobs"]["train"].clone();
    spec["data"] = json!({"stream": {"preset": "D1-multisine", "samples": 60}});
    spec["steps"] = 1_000_000.into();
    let id = product.submit(&spec).await;
    let mut process = worker(data.path(), &[]).spawn().unwrap();
    product.job_when(id, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
    for _ in 0..3 {
        signal("TERM", process.id());
    }
    assert_eq!(process.wait().unwrap().code(), Some(0));
    let tasks = product.get(&format!("/v1/jobs/{id}/tasks")).await;
    let task = &tasks["tasks"][0];
    assert_eq!((&task["state"], &task["attempt"]), (&json!("queued"), &json!(0)), "{task:#}");
    assert_eq!(task["error"], Value::Null, "{task:#}");
}
