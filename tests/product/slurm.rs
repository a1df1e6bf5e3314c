//! Workers on a real Slurm cluster. It starts, preempts, cancels and loses them, and is down for a
//! while.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::product::{
    PATIENCE, Product, is_alive, run_to_end, signal, skip, small_pipeline, torqued,
};
use crate::slurm_cluster::Cluster;

/// A cluster. `None` if this machine cannot run one; the test is then reported as skipped.
fn cluster(test: &str) -> Option<Cluster> {
    if let Some(obstacle) = Cluster::obstacle() {
        skip(test, &obstacle);
        return None;
    }
    Some(Cluster::start())
}

/// One task that takes some 10 s on one processor, and keeps a checkpoint every 20 steps.
fn training() -> Value {
    let mut spec = small_pipeline()["jobs"]["train"].clone();
    spec["data"] = json!({"stream": {"preset": "D1-multisine", "samples": 60}});
    spec["steps"] = 1500.into();
    spec
}

/// 12 tasks of about a second.
fn simulation() -> Value {
    let mut spec = small_pipeline()["jobs"]["train-set"].clone();
    spec["trajectories"] = 24_000.into();
    spec["shard_trajectories"] = 2000.into();
    spec
}

async fn when_it_gets_on(product: &Product, job: i64) {
    product.job_when(job, |job| job["progress"]["done"].as_f64() > Some(0.0)).await;
}

/// Waits until an attempt at a job's task has ended, and returns it.
async fn first_ended_attempt(product: &Product, job: i64) -> Value {
    let ended = |attempts: &Value| {
        let attempts = attempts["attempts"].as_array().unwrap();
        attempts.iter().find(|attempt| !attempt["reason"].is_null()).cloned()
    };
    let path = format!("/v1/jobs/{job}/attempts");
    ended(&product.when(&path, |attempts| ended(attempts).is_some()).await).unwrap()
}

/// Waits until the engine reports the end of a worker, and gives the report.
async fn ended_placement(product: &Product, worker: &Value) -> Value {
    let placement = |answer: &Value| {
        let lists = [answer["placements"].as_array(), answer["workers"].as_array()];
        let placements = lists.into_iter().flatten().flatten();
        let placements = placements.map(|placement| {
            if placement["placement"].is_null() { placement } else { &placement["placement"] }
        });
        placements
            .into_iter()
            .find(|placement| placement["worker"] == *worker && placement["state"] == "ended")
            .cloned()
    };
    placement(&product.when("/v1/workers", |answer| placement(answer).is_some()).await).unwrap()
}

/// Number of attempts at a job's only task.
async fn attempts_that_count(product: &Product, job: i64) -> Value {
    product.get(&format!("/v1/jobs/{job}/tasks")).await["tasks"][0]["attempt"].clone()
}

#[tokio::test]
async fn workers_that_slurm_starts_do_what_waits_and_end_when_nothing_does() {
    let test = "workers_that_slurm_starts_do_what_waits_and_end_when_nothing_does";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &["--max-workers", "2", "--idle-exit", "2"]);
    assert_eq!(cluster.jobs("all"), []);
    let id = product.submit(&simulation()).await;
    let began = Instant::now();
    let mut most = 0;
    loop {
        let jobs = cluster.jobs("PENDING,RUNNING,COMPLETING");
        assert!(jobs.len() <= 2, "more than the maximum: {jobs:?}");
        most = most.max(jobs.len());
        let job = product.get(&format!("/v1/jobs/{id}")).await;
        if job["state"] == "succeeded" {
            break;
        }
        assert!(job["state"] != "failed" && began.elapsed() < PATIENCE, "{job:#}");
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
    assert_eq!(most, 2);

    let answer = product
        .when("/v1/workers", |answer| {
            let ended = |placement: &Value| placement["state"] == "ended";
            answer["workers"].as_array().is_some_and(Vec::is_empty)
                && answer["placements"].as_array().is_some_and(|all| all.iter().all(ended))
        })
        .await;
    for placement in answer["placements"].as_array().unwrap() {
        assert_eq!(
            (&placement["engine"], &placement["reason"]),
            (&json!("Slurm"), &json!("ended"))
        );
        assert_eq!(placement["node"], "n1", "{placement:#}");
    }
    let finished = cluster.jobs("all");
    assert!(finished.iter().all(|(_, state)| state == "COMPLETED"), "{finished:?}");
    let health = product.get("/healthz").await;
    assert_eq!(health["status"], "ok", "{health:#}");
}

#[tokio::test]
async fn a_preempted_worker_gives_its_task_back_in_time_and_loses_no_attempt() {
    let test = "a_preempted_worker_gives_its_task_back_in_time_and_loses_no_attempt";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &["--slurm-option=--partition=low"]);
    let id = product.submit(&training()).await;
    when_it_gets_on(&product, id).await;
    let urgent =
        ["--parsable", "--partition=high", "--exclusive", "--output=/dev/null", "--wrap=sleep 5"];
    cluster.run("sbatch", &urgent);

    let attempt = first_ended_attempt(&product, id).await;
    assert_eq!(attempt["outcome"], "released", "{attempt:#}");
    let reason = attempt["reason"].as_str().unwrap();
    assert!(reason.ends_with("was preempted by Slurm"), "{reason}");
    let placement = ended_placement(&product, &attempt["worker"]).await;
    assert_eq!(placement["reason"], "was preempted by Slurm");
    product.succeeded(id).await;
    assert_eq!(attempts_that_count(&product, id).await, 1);
}

#[tokio::test]
async fn a_cancelled_worker_gives_its_task_back_in_time_and_loses_no_attempt() {
    let test = "a_cancelled_worker_gives_its_task_back_in_time_and_loses_no_attempt";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &[]);
    let id = product.submit(&training()).await;
    when_it_gets_on(&product, id).await;
    let jobs = cluster.jobs("RUNNING");
    cluster.run("scancel", &[&jobs[0].0]);
    let attempt = first_ended_attempt(&product, id).await;
    assert_eq!(attempt["outcome"], "released", "{attempt:#}");
    let reason = attempt["reason"].as_str().unwrap();
    assert!(reason.ends_with("was cancelled in Slurm (scancel)"), "{reason}");
    product.succeeded(id).await;
    assert_eq!(attempts_that_count(&product, id).await, 1);
}

#[tokio::test]
async fn a_worker_that_dies_or_loses_its_node_is_not_waited_for() {
    let test = "a_worker_that_dies_or_loses_its_node_is_not_waited_for";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    // A lease far longer than this test.
    let product = cluster.serve(data.path(), &["--lease-seconds", "3600"]);
    let id = product.submit(&training()).await;
    when_it_gets_on(&product, id).await;
    let workers = product.get("/v1/workers").await;
    let worker = u32::try_from(workers["workers"][0]["pid"].as_u64().unwrap()).unwrap();
    signal("KILL", worker);
    let attempt = first_ended_attempt(&product, id).await;
    assert_eq!(attempt["outcome"], "failed", "{attempt:#}");
    assert!(attempt["reason"].as_str().unwrap().contains("died: signal 9"), "{attempt:#}");

    product.task_when(id, |task| task["state"] == "running").await;
    cluster.run("scontrol", &["update", "nodename=n1", "state=down", "reason=test"]);
    let lost = |attempts: &Value| {
        let mut attempts = attempts["attempts"].as_array().unwrap().iter();
        attempts.any(|attempt| {
            attempt["reason"].as_str().is_some_and(|reason| reason.contains("lost its node"))
        })
    };
    product.when(&format!("/v1/jobs/{id}/attempts"), lost).await;
    cluster.run("scontrol", &["update", "nodename=n1", "state=resume"]);
    product.succeeded(id).await;
}

#[tokio::test]
async fn a_controller_that_is_away_for_a_while_is_said_once_and_waited_for() {
    let test = "a_controller_that_is_away_for_a_while_is_said_once_and_waited_for";
    let Some(mut cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &["--idle-exit", "5"]);
    cluster.kill_controller();
    let health = product.when("/healthz", |health| health["status"] == "degraded").await;
    let reason = health["reasons"][0].as_str().unwrap();
    assert!(reason.contains("no workers can be requested: Slurm's squeue failed"), "{reason}");
    let id = product.submit(&simulation()).await;
    cluster.start_controller();
    product.succeeded(id).await;
    product.when("/healthz", |health| health["status"] == "ok").await;
}

#[tokio::test]
async fn what_a_server_said_of_slurm_is_forgotten_when_another_without_it_goes_on() {
    let test = "what_a_server_said_of_slurm_is_forgotten_when_another_without_it_goes_on";
    let Some(mut cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let first = cluster.serve(data.path(), &[]);
    cluster.kill_controller();
    let speaks_of_slurm = |health: &Value| health.to_string().contains("Slurm's squeue failed");
    first.when("/healthz", speaks_of_slurm).await;
    let second = cluster.serve_with(data.path(), &["--workers", "0"]);
    assert!(speaks_of_slurm(&second.get("/healthz").await));
    first.end_by("KILL");
    let health = second.when("/healthz", |health| !speaks_of_slurm(health)).await;
    let reason = health["reasons"][0].as_str().unwrap();
    assert!(reason.contains("no worker is alive"), "{reason}");
}

#[tokio::test]
async fn a_server_that_is_started_anew_finds_its_workers_again() {
    let test = "a_server_that_is_started_anew_finds_its_workers_again";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &[]);
    let id = product.submit(&training()).await;
    when_it_gets_on(&product, id).await;
    let before = cluster.jobs("all");
    let workers = product.get("/v1/workers").await;
    let worker = u32::try_from(workers["workers"][0]["pid"].as_u64().unwrap()).unwrap();
    let (code, _) = product.end_by("TERM");
    assert_eq!(code, Some(0));
    assert!(is_alive(worker), "a worker of the cluster ended with the server");

    let product = cluster.serve(data.path(), &[]);
    product.succeeded(id).await;
    assert_eq!(attempts_that_count(&product, id).await, 1);
    let after = cluster.jobs("all");
    assert_eq!((before.len(), after.len()), (1, 1), "{after:?}");
}

#[tokio::test]
async fn workers_by_hand_come_from_the_script() {
    let test = "workers_by_hand_come_from_the_script";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve_with(data.path(), &["--workers", "0"]);
    let id = product.submit(&simulation()).await;
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_torqued")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let export =
        format!("--export=PATH={path},TORQUED_DATA={},TORQUED_DATABASE", data.path().display());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/deploy/slurm/workers.sbatch");
    let folder = format!("--output={}/%x-%a.log", data.path().display());
    let smaller = ["--array=1-2", "--cpus-per-task=1", "--mem=1G", &folder, &export, script];
    cluster.run("sbatch", &smaller);
    product.succeeded(id).await;
    // The first worker may have done everything before the second one is there.
    product.when("/v1/workers", |list| list["workers"].as_array().unwrap().len() == 2).await;
}

#[test]
fn a_cluster_asks_for_a_database_that_several_machines_may_use() {
    let data = tempfile::tempdir().unwrap();
    for executor in ["slurm", "kubernetes"] {
        let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--executor", executor]);
        let (code, _, errors) = run_to_end(command.arg("--data").arg(data.path()));
        assert_eq!(code, Some(1));
        let expected = format!("--executor {executor} needs --database postgres://");
        assert!(errors.contains(&expected), "{errors}");
    }
}

#[tokio::test]
async fn a_job_gets_a_worker_with_what_it_asks_for_and_slurm_shows_no_secret() {
    let test = "a_job_gets_a_worker_with_what_it_asks_for_and_slurm_shows_no_secret";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &[]);
    let mut spec = training();
    spec["execution"] = json!({"resources": {"cpus": 2, "memory_gb": 2.5, "tags": ["fast"]}});
    let id = product.submit(&spec).await;
    when_it_gets_on(&product, id).await;
    let workers = product.get("/v1/workers").await;
    let worker = &workers["workers"][0];
    let offers = json!({"cpus": 2, "gpus": 0, "memory_gb": 2.5, "tags": ["fast"]});
    assert_eq!((&worker["offers"], &worker["threads"]), (&offers, &json!(2)), "{workers:#}");

    let (number, _) = &cluster.jobs("RUNNING")[0];
    let job = cluster.run("scontrol", &["show", "--details", "job", number]);
    assert!(job.contains("NumCPUs=2") && job.contains("Features=fast"), "{job}");
    let script = cluster.run("scontrol", &["write", "batch_script", number, "-"]);
    assert!(script.contains("'worker'"), "{script}");
    let command = std::fs::read_to_string(format!("/proc/{}/cmdline", worker["pid"])).unwrap();
    for shown in [job, script, command] {
        assert!(!shown.contains(cluster.database()), "{shown}");
    }
    product.succeeded(id).await;
}

#[tokio::test]
async fn a_job_that_slurm_cannot_place_holds_up_no_other() {
    let test = "a_job_that_slurm_cannot_place_holds_up_no_other";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &["--max-workers", "1", "--idle-exit", "1"]);
    let mut impossible = simulation();
    impossible["execution"] = json!({"resources": {"tags": ["nowhere"]}});
    let waits = product.submit(&impossible).await;
    let health = product.when("/healthz", |health| health["status"] == "degraded").await;
    let reason = health["reasons"][0].as_str().unwrap();
    let expected = "no more workers can be requested: Slurm's sbatch failed";
    assert!(reason.contains(expected) && reason.contains("feature"), "{reason}");
    let id = product.submit(&training()).await;
    product.succeeded(id).await;
    let job = product.get(&format!("/v1/jobs/{waits}")).await;
    assert_eq!(job["state"], "queued", "{job:#}");
    assert_eq!(job["waits_for"], "no worker offers tag nowhere; Slurm is asked for one");
}

#[tokio::test]
async fn workers_that_cannot_begin_are_not_asked_for_again_and_again() {
    let test = "workers_that_cannot_begin_are_not_asked_for_again_and_again";
    let Some(cluster) = cluster(test) else { return };
    let data = tempfile::tempdir().unwrap();
    let product = cluster.serve(data.path(), &["--worker-program", "/nowhere/torqued"]);
    product.submit(&training()).await;
    let health = product.when("/healthz", |health| health["status"] == "degraded").await;
    let reason = health["reasons"][0].as_str().unwrap();
    let expected = "end before they begin";
    assert!(reason.contains(expected) && reason.contains("exit code 127"), "{reason}");
    drop(product);

    let product = cluster.serve(data.path(), &["--slurm-option=--partition=nowhere"]);
    // The database keeps the last server's message until this one asks.
    let is_refused = |health: &Value| {
        let mut reasons = health["reasons"].as_array().into_iter().flatten();
        reasons.any(|reason| {
            let refusal = "Slurm's sbatch failed: invalid partition";
            reason.as_str().is_some_and(|reason| reason.contains(refusal))
        })
    };
    product.when("/healthz", is_refused).await;
    // Pauses double, so there were only a few in this time.
    assert!(cluster.jobs("all").len() < 10);
}
