//! Shards can be made again: with or without a server, by any number of workers, one of them
//! killed, and verified afterwards.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::product::{PATIENCE, Product, run_to_end, signal, torqued};

/// Eight shards, together a second or two of work.
fn simulation() -> Value {
    json!({
        "preset": "D2-mixed", "trajectories": 16_000, "samples": 60, "shard_trajectories": 2000,
        "observations": {"joint_velocities": true, "end_effector_pose": true},
    })
}

fn write_spec(dir: &Path, spec: &Value) -> String {
    let path = dir.join("spec.json");
    std::fs::write(&path, spec.to_string()).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Runs `torqued simulate` on a spec.
fn simulate(dir: &Path, spec: &Value, out: &Path) -> (Option<i32>, String, String) {
    let spec = write_spec(dir, spec);
    run_to_end(torqued(&["simulate", "--spec", &spec, "--out"]).arg(out))
}

fn verify_folder(out: &Path) -> (Option<i32>, String, String) {
    run_to_end(torqued(&["verify"]).arg(out))
}

/// SHA-256 by name of the files that `dataset.json` names.
fn described(out: &Path) -> BTreeMap<String, String> {
    let text = std::fs::read(out.join("dataset.json")).unwrap();
    let description: Value = serde_json::from_slice(&text).unwrap();
    let shards = description["shards"].as_array().unwrap().clone();
    shards.iter().flat_map(|shard| digests(&shard["files"])).collect()
}

fn digests(files: &Value) -> BTreeMap<String, String> {
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let files = files.as_array().unwrap().iter();
    files.map(|file| (text(&file["name"]), text(&file["sha256"]))).collect()
}

/// A dataset's id and the digests of its files.
async fn dataset_of(product: &Product, job: i64) -> (i64, BTreeMap<String, String>) {
    let id = product.get(&format!("/v1/jobs/{job}")).await["dataset"].as_i64().unwrap();
    let dataset = product.get(&format!("/v1/datasets/{id}")).await;
    let files = dataset["files"].as_array().unwrap().clone();
    let tables = files.iter().filter(|file| file["name"].as_str().unwrap().ends_with(".parquet"));
    (id, digests(&Value::Array(tables.cloned().collect())))
}

fn names(dir: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(dir).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The objects of a data folder whose names contain `part`.
fn objects(data: &Path, part: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![data.join("objects")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
            if entry.path().is_dir() {
                folders.push(entry.path());
            } else if entry.file_name().to_str().unwrap().contains(part) {
                found.push(entry.path());
            }
        }
    }
    found
}

#[tokio::test]
async fn one_two_and_four_workers_with_one_killed_and_no_server_at_all_give_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("folder");
    let (code, output, errors) = simulate(dir.path(), &simulation(), &out);
    assert_eq!(code, Some(0), "{output}{errors}");
    let expected = described(&out);
    assert_eq!(expected.len(), 16);
    let (code, output, errors) = verify_folder(&out);
    assert_eq!(code, Some(0), "{output}{errors}");
    assert!(output.contains("every byte equal"), "{output}");

    for workers in ["1", "2", "4"] {
        let data = tempfile::tempdir().unwrap();
        let arguments = ["--workers", workers, "--worker-threads", "1", "--lease-seconds", "2"];
        let product = Product::start_with(data.path(), &arguments);
        let job = product.submit(&simulation()).await;
        let under_way = |job: &Value| job["progress"]["done"].as_f64() > Some(0.0);
        product.job_when(job, under_way).await;
        product.kill_worker().await;
        product.succeeded(job).await;
        let (id, files) = dataset_of(&product, job).await;
        assert_eq!(files, expected, "{workers} workers");

        let arguments = ["verify", &id.to_string(), "--server", &product.url];
        let (code, output, errors) = run_to_end(&mut torqued(&arguments));
        assert_eq!(code, Some(0), "{output}{errors}");
    }
}

#[tokio::test]
async fn a_damaged_or_missing_shard_fails_its_verification_for_good_and_harms_no_worker() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let job = product.submit(&simulation()).await;
    product.succeeded(job).await;
    let (id, _) = dataset_of(&product, job).await;

    let damaged = &objects(data.path(), "shard-00003-e1-trajectories")[0];
    let mut bytes = std::fs::read(damaged).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(damaged, &bytes).unwrap();
    let failed = verification(&product, id).await;
    let error = failed["error"].as_str().unwrap();
    assert!(error.contains("shard-00003") && error.contains("checksum mismatch"), "{error}");
    let tasks = product.get(&format!("/v1/jobs/{}/tasks", failed["id"])).await;
    let attempts: Vec<i64> = tasks["tasks"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|task| task["state"] == "failed")
        .map(|task| task["attempt"].as_i64().unwrap())
        .collect();
    assert_eq!(attempts, [1], "damage does not pass");

    std::fs::remove_file(damaged).unwrap();
    let error = verification(&product, id).await["error"].as_str().unwrap().to_owned();
    assert!(error.contains("is missing"), "{error}");

    bytes[middle] ^= 1;
    std::fs::write(damaged, &bytes).unwrap();
    assert_eq!(verification(&product, id).await["state"], "succeeded");
}

/// The finished job that verifies a dataset.
async fn verification(product: &Product, dataset: i64) -> Value {
    let (status, job) = product.post(&format!("/v1/datasets/{dataset}/verify"), "").await;
    assert!(status.is_success(), "{job}");
    product.finished(job["id"].as_i64().unwrap()).await
}

#[test]
fn an_interrupted_simulation_leaves_whole_shards_and_goes_on_from_them() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("folder");
    let mut spec = simulation();
    spec["trajectories"] = 200_000.into();
    let path = write_spec(dir.path(), &spec);
    let mut process = torqued(&["simulate", "--spec", &path, "--out"])
        .arg(&out)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while !out.join("robots-00000.parquet").exists() {
        assert!(started.elapsed() < PATIENCE, "no shard");
        std::thread::sleep(Duration::from_millis(20));
    }
    signal("INT", process.id());
    assert_eq!(process.wait().unwrap().code(), Some(1));
    let interrupted = described(&out);
    assert!(!interrupted.is_empty() && interrupted.len() < 200);
    let mut expected: Vec<String> = interrupted.keys().cloned().collect();
    expected.insert(0, "dataset.json".to_owned());
    expected.sort();
    assert_eq!(names(&out), expected);
    let (code, _, errors) = verify_folder(&out);
    assert_eq!(code, Some(1));
    assert!(errors.contains("is not complete"), "{errors}");

    // After a SIGKILL it continues as well, and no hidden files stay.
    let mut process = torqued(&["simulate", "--spec", &path, "--out"])
        .arg(&out)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while described(&out).len() <= interrupted.len() + 2 {
        assert!(started.elapsed() < PATIENCE, "no further shard");
        std::thread::sleep(Duration::from_millis(20));
    }
    process.kill().unwrap();
    process.wait().unwrap();
    let (code, output, errors) = simulate(dir.path(), &spec, &out);
    assert_eq!(code, Some(0), "{output}{errors}");
    assert_eq!(names(&out).len(), 1 + 2 * 100);
}

#[test]
fn simulations_without_a_server_come_with_the_server_s_warnings() {
    let dir = tempfile::tempdir().unwrap();
    let mut spec = simulation();
    spec["trajectories"] = 10.into();
    spec["integrator"] = json!({"scheme": "reference"});
    let (code, _, errors) = simulate(dir.path(), &spec, &dir.path().join("coarse"));
    assert_eq!(code, Some(0), "{errors}");
    assert!(errors.contains("warning: integrator is "), "{errors}");
    spec["integrator"] = json!({"scheme": "rk4"});
    let (code, _, errors) = simulate(dir.path(), &spec, &dir.path().join("fine"));
    assert_eq!(code, Some(0), "{errors}");
    assert!(!errors.contains("warning"), "{errors}");
}

#[test]
fn a_folder_of_another_spec_and_a_job_of_another_kind_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("folder");
    let mut spec = simulation();
    spec["trajectories"] = 100.into();
    assert_eq!(simulate(dir.path(), &spec, &out).0, Some(0));
    spec["seed"] = 77.into();
    let (code, _, errors) = simulate(dir.path(), &spec, &out);
    assert_eq!(code, Some(1));
    assert!(errors.contains("has a dataset with digest"), "{errors}");

    let quickstart = json!({"preset": "quickstart"});
    let (code, _, errors) = simulate(dir.path(), &quickstart, &dir.path().join("other"));
    assert_eq!(code, Some(1));
    assert!(errors.contains("allowed: simulate"), "{errors}");
    spec["seed"] = (-1).into();
    let (code, _, errors) = simulate(dir.path(), &spec, &dir.path().join("other"));
    assert_eq!(code, Some(1));
    assert!(errors.contains("seed"), "{errors}");
    assert!(!dir.path().join("other").exists());
}
