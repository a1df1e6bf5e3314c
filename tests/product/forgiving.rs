//! The queue survives ordinary mishaps: cancellations, a laptop that sleeps, upgrades, lost
//! workers, and retries.

use std::path::Path;
use std::time::{Duration, Instant};

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, is_alive, run_to_end, signal, small_pipeline, torqued};

/// "Within two seconds" on a busy machine. The interrupted work would take minutes.
const SOON: Duration = Duration::from_secs(20);

/// An evaluation with one cell and one predictor, which takes minutes.
fn slow_evaluation() -> Value {
    json!({
        "kind": "evaluate",
        "data": {"stream": {
            "preset": "D1-chirp", "trajectories": 4000, "samples": 400,
            "excitation": {"chirp": {"frequency_hz": {"grid": [0.2]}}},
        }},
        "baselines": ["identification"],
        "context": 320,
        "scenarios": 4000,
    })
}

/// Waits until the scenarios are simulated and the predictor computes.
async fn when_it_computes(product: &Product, job: i64) {
    product.task_when(job, |task| task["state"] == "running").await;
    tokio::time::sleep(Duration::from_secs(5)).await;
}

#[tokio::test]
async fn a_cancelled_evaluation_ends_in_the_middle_of_a_predictor() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&slow_evaluation()).await;
    when_it_computes(&product, id).await;
    let asked = Instant::now();
    let (status, _) = product.post(&format!("/v1/jobs/{id}/cancel"), "").await;
    assert_eq!(status, StatusCode::OK);
    let job = product.finished(id).await;
    assert_eq!(job["state"], "cancelled", "{job:#}");
    assert!(asked.elapsed() < SOON, "took {:?}", asked.elapsed());
    let tasks = product.get(&format!("/v1/jobs/{id}/tasks")).await;
    assert_eq!(tasks["tasks"][0]["state"], "cancelled", "{tasks:#}");
}

#[tokio::test]
async fn sigterm_in_the_middle_of_a_predictor_costs_no_attempt() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&slow_evaluation()).await;
    when_it_computes(&product, id).await;
    let (code, took) = product.end_by("TERM");
    assert_eq!(code, Some(0));
    assert!(took < SOON, "took {took:?}");
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let tasks = product.get(&format!("/v1/jobs/{id}/tasks")).await;
    let task = &tasks["tasks"][0];
    assert_eq!((&task["state"], &task["attempt"]), (&json!("queued"), &json!(0)), "{task:#}");
    assert_eq!(task["error"], Value::Null, "{task:#}");
}

fn training(steps: u32) -> Value {
    let mut spec = small_pipeline()["jobs"]["train"].clone();
    spec["data"] = json!({"stream": {"preset": "D1-multisine", "samples": 60}});
    spec["steps"] = steps.into();
    spec["keep_checkpoints"] = 1000.into();
    spec
}

#[tokio::test]
async fn a_machine_that_sleeps_again_and_again_fails_no_training() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&training(1500)).await;
    product.job_when(id, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
    for _ in 0..4 {
        let sleeping = [vec![product.pid()], product.workers()].concat();
        sleeping.iter().for_each(|pid| signal("STOP", *pid));
        // Twice the length of a lease.
        tokio::time::sleep(Duration::from_secs(4)).await;
        sleeping.iter().for_each(|pid| signal("CONT", *pid));
        tokio::time::sleep(Duration::from_secs(1)).await;
    }
    product.succeeded(id).await;
    let tasks = product.get(&format!("/v1/jobs/{id}/tasks")).await;
    let task = &tasks["tasks"][0];
    assert_eq!((&task["attempt"], &task["epoch"]), (&json!(1), &json!(1)), "{task:#}");
}

#[tokio::test]
async fn a_dead_worker_is_not_waited_for() {
    let data = tempfile::tempdir().unwrap();
    // A lease far longer than this test.
    let product =
        Product::start_with(data.path(), &["--worker-threads", "1", "--lease-seconds", "3600"]);
    let id = product.submit(&training(300)).await;
    product.job_when(id, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
    product.kill_worker().await;
    let task = &product.get(&format!("/v1/jobs/{id}/tasks")).await["tasks"][0].clone();
    assert_ne!(task["state"], "failed", "{task:#}");
    product.succeeded(id).await;
}

/// The steps of a job's checkpoints, and the digests of the last.
async fn checkpoints(product: &Product, job: &Value) -> (Vec<u64>, Vec<Value>) {
    let (mut steps, mut digests) = (Vec::new(), Vec::new());
    for id in job["checkpoints"].as_array().unwrap() {
        let checkpoint = product.get(&format!("/v1/checkpoints/{id}")).await;
        steps.push(checkpoint["step"].as_u64().unwrap());
        let files = checkpoint["files"].as_array().unwrap();
        digests = files.iter().map(|file| file["sha256"].clone()).collect();
    }
    (steps, digests)
}

async fn losses(product: &Product, job: &Value) -> Vec<(Value, Value)> {
    let metric = product.get(&format!("/v1/runs/{}/metrics/train/loss", job["run"])).await;
    let points = metric["points"].as_array().unwrap().iter();
    points.map(|point| (point["step"].clone(), point["value"].clone())).collect()
}

#[tokio::test]
async fn a_cancelled_training_that_is_tried_again_goes_on_from_its_last_checkpoint() {
    let undisturbed_data = tempfile::tempdir().unwrap();
    let undisturbed = Product::start(undisturbed_data.path());
    let id = undisturbed.submit(&training(2000)).await;
    let expected = undisturbed.succeeded(id).await;

    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let first = product.submit(&training(2000)).await;
    product.job_when(first, |job| job["progress"]["done"].as_f64() > Some(60.0)).await;
    product.post(&format!("/v1/jobs/{first}/cancel"), "").await;
    let cancelled = product.finished(first).await;
    assert_eq!(cancelled["state"], "cancelled", "{cancelled:#}");
    let (kept, _) = checkpoints(&product, &cancelled).await;

    let (status, job) = product.post(&format!("/v1/jobs/{first}/retry"), "").await;
    assert_eq!(status, StatusCode::CREATED, "{job}");
    let job = product.succeeded(job["id"].as_i64().unwrap()).await;
    let (steps, digests) = checkpoints(&product, &job).await;
    let before = steps.iter().filter(|step| *step < kept.last().unwrap()).count();
    assert!(steps.contains(kept.last().unwrap()) && before <= 1, "{steps:?} after {kept:?}");
    assert_eq!(digests, checkpoints(&undisturbed, &expected).await.1);
    assert_eq!(losses(&product, &job).await, losses(&undisturbed, &expected).await);
}

#[tokio::test]
async fn shards_of_a_cancelled_simulation_are_not_simulated_again() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = small_pipeline()["jobs"]["train-set"].clone();
    spec["trajectories"] = 30_000.into();
    let first = product.submit(&spec).await;
    product.job_when(first, |job| job["progress"]["done"].as_f64() > Some(3000.0)).await;
    product.post(&format!("/v1/jobs/{first}/cancel"), "").await;
    let cancelled = product.finished(first).await;
    let dataset = product.get(&format!("/v1/datasets/{}", cancelled["dataset"])).await;
    assert_eq!(dataset["state"], "abandoned", "{dataset:#}");
    let made = files(&dataset);

    let (_, job) = product.post(&format!("/v1/jobs/{first}/retry"), "").await;
    let job = product.succeeded(job["id"].as_i64().unwrap()).await;
    let again = product.get(&format!("/v1/datasets/{}", job["dataset"])).await;
    assert_eq!(files(&again)[..made.len()], made[..]);
    // A file with two names was linked and not written again.
    let linked = std::fs::read_dir(data.path().join(format!("objects/datasets/{}", job["id"])))
        .unwrap()
        .filter(|entry| links(&entry.as_ref().unwrap().path()) == 2)
        .count();
    assert_eq!(linked, made.len());
}

/// Digests of the files of a dataset's shards.
fn files(dataset: &Value) -> Vec<Value> {
    let files = dataset["files"].as_array().unwrap().iter();
    let shards = files.filter(|file| file["name"] != "dataset.json");
    shards.map(|file| json!([file["name"], file["sha256"]])).collect()
}

fn links(file: &Path) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(&file.metadata().unwrap())
}

#[tokio::test]
async fn a_training_whose_newest_checkpoint_is_damaged_goes_on_from_the_one_before() {
    let undisturbed_data = tempfile::tempdir().unwrap();
    let undisturbed = Product::start(undisturbed_data.path());
    let id = undisturbed.submit(&training(2000)).await;
    let expected = undisturbed.succeeded(id).await;

    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&training(2000)).await;
    product.job_when(id, |job| job["progress"]["done"].as_f64() > Some(60.0)).await;
    product.end_by("INT");
    let folder = data.path().join(format!("objects/checkpoints/{id}"));
    let mut kept: Vec<_> =
        std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    kept.sort();
    let newest = kept.last().unwrap().join("model.safetensors");
    let mut bytes = std::fs::read(&newest).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&newest, bytes).unwrap();

    let product = Product::start(data.path());
    let job = product.succeeded(id).await;
    let digests = checkpoints(&product, &job).await.1;
    assert_eq!(digests, checkpoints(&undisturbed, &expected).await.1);
    assert_eq!(losses(&product, &job).await, losses(&undisturbed, &expected).await);
}

#[tokio::test]
async fn a_program_that_is_replaced_under_a_running_server_still_starts_its_workers() {
    let place = tempfile::tempdir().unwrap();
    let program = place.path().join("torqued");
    std::fs::copy(env!("CARGO_BIN_EXE_torqued"), &program).unwrap();
    let mut serve = std::process::Command::new(&program);
    serve.args(["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1", "--data"]);
    let product = Product::spawn(serve.arg(place.path().join("data")));
    product.when_worker_is_there().await;
    std::fs::remove_file(&program).unwrap();
    std::fs::write(&program, "#!/bin/sh\nexit 1\n").unwrap();
    let before = product.workers();
    product.kill_worker().await;
    let id = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.succeeded(id).await;
    assert!(!before.iter().any(|pid| is_alive(*pid)));
}

#[tokio::test]
async fn the_health_tells_of_a_missing_worker_and_a_missing_database() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let health = product.get("/healthz").await;
    assert_eq!((&health["status"], &health["workers"]), (&json!("degraded"), &json!(0)));
    let reason = health["reasons"][0].as_str().unwrap();
    assert!(reason.contains("torqued worker"), "{reason}");
    std::fs::remove_file(data.path().join("torqued.sqlite")).unwrap();
    let (status, problem) = product.try_get("/healthz").await;
    assert_eq!(status, StatusCode::SERVICE_UNAVAILABLE, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("deleted or replaced"), "{problem}");
}

#[tokio::test]
async fn workers_are_listed_with_what_they_do() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    product.when_worker_is_there().await;
    let id = product.submit(&training(100_000)).await;
    product.job_when(id, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
    let workers = product.get("/v1/workers").await;
    let worker = &workers["workers"][0];
    assert_eq!((&worker["name"], &worker["alive"]), (&json!("worker-1"), &json!(true)));
    assert_eq!(worker["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!((&worker["device"], &worker["threads"]), (&json!("cpu"), &json!(1)));
    assert_eq!((&worker["task"]["job"], &worker["task"]["label"]), (&json!(id), &json!("train")));
    assert_eq!(product.get("/healthz").await["status"], "ok");
    let (code, output, errors) = run_to_end(torqued(&["workers", "--server"]).arg(&product.url));
    assert_eq!(code, Some(0), "{errors}");
    assert!(output.contains("worker-1") && output.contains("train"), "{output}");
}

#[tokio::test]
async fn a_dataset_of_more_shards_than_a_process_may_have_files_is_read() {
    let data = tempfile::tempdir().unwrap();
    let inner = torqued(&["serve", "--listen", "127.0.0.1:0", "--worker-threads", "1", "--data"]);
    let mut serve = std::process::Command::new("bash");
    serve.args(["-c", "ulimit -n 192; exec \"$@\"", "bash"]);
    serve.arg(inner.get_program()).args(inner.get_args()).arg(data.path());
    let product = Product::spawn(&mut serve);
    let mut spec = small_pipeline();
    spec["jobs"]["train-set"]["trajectories"] = 1000.into();
    spec["jobs"]["train-set"]["shard_trajectories"] = 5.into();
    spec["jobs"]["train"]["steps"] = 60.into();
    let id = product.submit(&spec).await;
    product.succeeded(id).await;
}

#[tokio::test]
async fn a_paused_queue_runs_dry_and_goes_on_after_the_next_start() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    product.job_when(id, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
    let (code, output, errors) =
        run_to_end(torqued(&["pause", "--wait", "--server"]).arg(&product.url));
    assert_eq!(code, Some(0), "{errors}");
    assert!(output.contains("no task is running"), "{output}");
    let waiting = product.submit(&training(100)).await;
    let health = product.get("/healthz").await;
    assert!(health["reasons"][0].as_str().unwrap().contains("paused"), "{health:#}");
    assert_eq!(product.end_by("TERM").0, Some(0));

    let product = Product::start(data.path());
    product.when_worker_is_there().await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    assert_eq!(product.get(&format!("/v1/jobs/{waiting}")).await["state"], "queued");
    let (code, output, errors) = run_to_end(torqued(&["resume", "--server"]).arg(&product.url));
    assert_eq!(code, Some(0), "{errors}");
    assert!(output.contains("resumed"), "{output}");
    product.succeeded(id).await;
    product.succeeded(waiting).await;
}

#[tokio::test]
async fn a_worker_of_another_version_claims_nothing_unless_it_is_allowed() {
    use sqlx::{ConnectOptions, Connection};
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let id = product.submit(&small_pipeline()["jobs"]["train-set"]).await;
    let file = data.path().join("torqued.sqlite");
    let mut connection =
        sqlx::sqlite::SqliteConnectOptions::new().filename(file).connect().await.unwrap();
    sqlx::query("UPDATE server SET version = '9.9.9'").execute(&mut connection).await.unwrap();
    connection.close().await.unwrap();

    let worker = |arguments: &[&str]| {
        let mut command = torqued(&["worker", "--name", "other", "--threads", "1", "--data"]);
        command.arg(data.path()).args(arguments).spawn().unwrap()
    };
    let mut refused = worker(&[]);
    let says = |answer: &Value| answer["workers"][0]["waits_for"].is_string();
    let workers = product.when("/v1/workers", says).await;
    let reason = workers["workers"][0]["waits_for"].as_str().unwrap();
    assert!(reason.contains("9.9.9") && reason.contains("--any-version"), "{reason}");
    assert_eq!(product.get(&format!("/v1/jobs/{id}")).await["state"], "queued");
    signal("TERM", refused.id());
    assert!(refused.wait().unwrap().success());

    let mut allowed = worker(&["--any-version"]);
    product.succeeded(id).await;
    signal("TERM", allowed.id());
    assert!(allowed.wait().unwrap().success());
}

#[tokio::test]
async fn a_job_that_takes_too_long_fails_and_can_be_tried_again_from_where_it_was() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = training(100_000);
    spec["execution"] = json!({"time_limit_s": 3});
    let id = product.submit(&spec).await;
    let job = product.finished(id).await;
    assert_eq!(job["state"], "failed", "{job:#}");
    assert!(job["error"].as_str().unwrap().contains("time limit of 3 s"), "{job:#}");
    let done = checkpoints(&product, &job).await.0;
    let (_, again) = product.post(&format!("/v1/jobs/{id}/retry"), "").await;
    let again = product.finished(again["id"].as_i64().unwrap()).await;
    let further = checkpoints(&product, &again).await.0;
    assert!(further.contains(done.last().unwrap()) && further.last() > done.last(), "{further:?}");
}

/// The checkpoints are those of another version of torqued, as after an upgrade between two
/// attempts.
#[tokio::test]
async fn a_training_that_is_tried_again_begins_anew_where_no_checkpoint_can_be_loaded() {
    use sqlx::{ConnectOptions, Connection, Row};
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let first = product.submit(&training(3000)).await;
    product.job_when(first, |job| job["progress"]["done"].as_f64() > Some(60.0)).await;
    product.post(&format!("/v1/jobs/{first}/cancel"), "").await;
    assert_eq!(product.finished(first).await["state"], "cancelled");
    product.end_by("INT");

    let file = data.path().join("torqued.sqlite");
    let mut connection =
        sqlx::sqlite::SqliteConnectOptions::new().filename(file).connect().await.unwrap();
    let configs = sqlx::query("SELECT path FROM checkpoint_file WHERE name = 'config.json'")
        .fetch_all(&mut connection)
        .await
        .unwrap();
    assert!(!configs.is_empty());
    for path in configs.iter().map(|row| row.get::<String, _>("path")) {
        let config = data.path().join("objects").join(&path);
        let mut edited: Value = serde_json::from_slice(&std::fs::read(&config).unwrap()).unwrap();
        edited["format"] = 999.into();
        let bytes = edited.to_string().into_bytes();
        std::fs::write(config, &bytes).unwrap();
        sqlx::query("UPDATE checkpoint_file SET sha256 = ?, size = ? WHERE path = ?")
            .bind(spec::Digest::of(&bytes).to_string())
            .bind(i64::try_from(bytes.len()).unwrap())
            .bind(path)
            .execute(&mut connection)
            .await
            .unwrap();
    }
    connection.close().await.unwrap();

    let product = Product::start(data.path());
    let (_, job) = product.post(&format!("/v1/jobs/{first}/retry"), "").await;
    let job = product.succeeded(job["id"].as_i64().unwrap()).await;
    assert_eq!(checkpoints(&product, &job).await.0[0], 20);
}
