//! A worker that dies by SIGKILL at any moment of any kind of job changes no result.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use crate::pipeline::results;
use crate::product::{Product, member, small_pipeline};

/// Number of kills for each kind of job. `KILLS=10` raises it.
fn kills() -> u32 {
    std::env::var("KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(3)
}

#[tokio::test]
async fn a_killed_worker_changes_no_result_of_any_kind_of_job() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&small_pipeline()).await;
    let undisturbed = product.succeeded(id).await;
    let expected = results(&product, &undisturbed).await;
    let mut durations = Vec::new();
    for name in ["train-set", "train", "evaluate"] {
        let job = product.get(&format!("/v1/jobs/{}", member(&undisturbed, name))).await;
        durations.push((name, duration(&job)));
    }
    drop(product);

    for round in 0..kills() {
        let data = tempfile::tempdir().unwrap();
        let product = Product::start(data.path());
        let id = product.submit(&small_pipeline()).await;
        for (name, duration) in &durations {
            product.job_when(id, |pipeline| has_started(pipeline, name)).await;
            let moment = duration.mul_f64(random_fraction());
            eprintln!("round {round}: SIGKILL {moment:?} into {name}, which takes {duration:?}");
            tokio::time::sleep(moment).await;
            product.kill_worker().await;
        }
        let pipeline = product.succeeded(id).await;
        assert_eq!(results(&product, &pipeline).await, expected, "round {round}");
    }
}

#[tokio::test]
async fn a_job_that_kills_every_worker_fails_after_its_attempts() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = small_pipeline();
    spec["jobs"]["train"]["steps"] = 1_000_000.into();
    // No attempt keeps a checkpoint.
    spec["jobs"]["train"]["checkpoint_every_steps"] = 1_000_000.into();
    spec["jobs"]["train"]["validate_every_steps"] = 1_000_000.into();
    spec["jobs"]["train"]["execution"] = serde_json::json!({"max_attempts": 2});
    let id = product.submit(&spec).await;
    let training = member(&product.get(&format!("/v1/jobs/{id}")).await, "train");
    for attempt in 1..=2 {
        product.task_when(training, |task| is_under_way(task, attempt)).await;
        product.kill_worker().await;
    }
    let job = product.finished(training).await;
    assert_eq!(job["state"], "failed", "{job:#}");
    assert!(job["error"].as_str().is_some_and(|error| !error.is_empty()), "{job:#}");
}

fn is_under_way(task: &Value, attempt: u32) -> bool {
    let done = task["progress"]["done"].as_f64();
    task["attempt"] == attempt && task["state"] == "running" && done > Some(0.0)
}

fn has_started(pipeline: &Value, name: &str) -> bool {
    let members = pipeline["members"].as_array().unwrap();
    members.iter().any(|member| {
        member["name"] == name
            && !["waiting", "queued"].contains(&member["state"].as_str().unwrap())
    })
}

fn duration(job: &Value) -> Duration {
    let at = |key: &str| humantime::parse_rfc3339_weak(job[key].as_str().unwrap()).unwrap();
    at("finished_at").duration_since(at("started_at")).unwrap()
}

/// A random number from 0 to 1. The caller prints it, because a failure may depend on it.
fn random_fraction() -> f64 {
    let nanoseconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().subsec_nanos();
    f64::from(nanoseconds % 10_007) / 10_007.0
}
