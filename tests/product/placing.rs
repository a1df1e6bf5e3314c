//! The choice of a worker for each job, and its time.

use std::time::{Duration, SystemTime};

use serde_json::{Value, json};

use crate::product::{Product, run_to_end, signal, small_pipeline, torqued};

fn simulation(seed: u64, execution: Value) -> Value {
    let mut spec = small_pipeline()["jobs"]["train-set"].clone();
    (spec["seed"], spec["execution"]) = (seed.into(), execution);
    spec
}

fn told(command: &str, product: &Product) -> String {
    let words: Vec<&str> = command.split(' ').collect();
    let (code, output, errors) = run_to_end(torqued(&words).args(["--server", &product.url]));
    assert_eq!(code, Some(0), "{command}: {errors}");
    output
}

#[tokio::test]
async fn a_job_goes_to_the_worker_that_offers_what_it_asks_for() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(
        data.path(),
        &["--worker-threads", "1", "--worker-memory-gb", "2", "--worker-tag", "here"],
    );
    product.when_worker_is_there().await;
    let resources = json!({"gpus": 1, "memory_gb": 3, "tags": ["rig"]});
    let asks = product.submit(&simulation(1, json!({"resources": resources}))).await;
    let flags = "torqued worker --gpus 1 --memory-gb 3 --tag rig";
    let job = product.get(&format!("/v1/jobs/{asks}")).await;
    assert!(job["waits_for"].as_str().unwrap().contains(flags), "{job:#}");
    assert!(told("jobs", &product).contains(flags));
    let health = product.get("/healthz").await;
    assert!(health["reasons"][0].as_str().unwrap().contains(flags), "{health:#}");

    let small = json!({"resources": {"cpus": 1, "memory_gb": 2, "tags": ["here"]}});
    let small = product.submit(&simulation(2, small)).await;
    product.succeeded(small).await;
    assert_eq!(product.get(&format!("/v1/jobs/{asks}")).await["state"], "queued");

    let flags: Vec<&str> = flags.split(' ').skip(1).collect();
    let mut rig = torqued(&flags)
        .args(["--name", "rig-7", "--threads", "1", "--data"])
        .arg(data.path())
        .spawn()
        .unwrap();
    product.succeeded(asks).await;
    let attempts = product.get(&format!("/v1/jobs/{asks}/attempts")).await;
    let workers = attempts["attempts"].as_array().unwrap().iter().map(|attempt| &attempt["worker"]);
    assert!(workers.clone().all(|worker| worker == "rig-7"), "{attempts:#}");
    let listed = told("workers", &product);
    assert!(listed.contains("1 gpu, 3.0 GB, rig") && listed.contains("2.0 GB, here"), "{listed}");

    assert!(told("drain rig-7 --wait", &product).contains("rig-7 has no task"));
    let waits = product.submit(&simulation(3, json!({"resources": {"gpus": 1}}))).await;
    let job = product.get(&format!("/v1/jobs/{waits}")).await;
    assert!(job["waits_for"].as_str().unwrap().contains("torqued undrain rig-7"), "{job:#}");
    assert!(told("workers", &product).contains("it is drained"));
    told("undrain rig-7", &product);
    product.succeeded(waits).await;
    signal("TERM", rig.id());
    assert!(rig.wait().unwrap().success());
}

#[tokio::test]
async fn a_job_begins_at_the_moment_that_was_asked_for() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let moment = SystemTime::now() + Duration::from_secs(5);
    let moment = humantime::format_rfc3339_seconds(moment).to_string();
    let later =
        product.submit(&simulation(1, json!({"not_before": moment, "priority": 100}))).await;
    let now = product.submit(&simulation(2, json!({}))).await;
    let job = product.get(&format!("/v1/jobs/{later}")).await;
    let waits_for = job["waits_for"].as_str();
    // On a busy machine the moment may have passed already.
    assert!(waits_for.is_none_or(|reason| reason == format!("from {moment} on")), "{job:#}");
    product.succeeded(now).await;
    let job = product.succeeded(later).await;
    assert_eq!(job["not_before"], moment);
    let parse = |text: &str| humantime::parse_rfc3339(text).unwrap();
    assert!(parse(job["started_at"].as_str().unwrap()) >= parse(&moment), "{job:#}");
}

#[tokio::test]
async fn an_operator_limits_the_time_of_all_jobs_of_a_kind() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(
        data.path(),
        &["--worker-threads", "1", "--time-limit", "train=2", "--time-limit", "simulate=3600"],
    );
    let mut spec = small_pipeline()["jobs"]["train"].clone();
    spec["data"] = json!({"stream": {"preset": "D1-multisine", "samples": 60}});
    spec["steps"] = 1_000_000.into();
    let id = product.submit(&spec).await;
    let job = product.finished(id).await;
    assert_eq!((&job["state"], &job["time_limit_s"]), (&json!("failed"), &json!(2)), "{job:#}");
    assert!(job["error"].as_str().unwrap().contains("time limit of 2 s"), "{job:#}");
    spec["execution"] = json!({"time_limit_s": 3});
    let (status, problem) = product.post("/v1/jobs", spec.to_string()).await;
    assert_eq!(status.as_u16(), 422, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("--time-limit train=2"), "{problem}");
}
