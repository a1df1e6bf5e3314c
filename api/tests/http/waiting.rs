//! Jobs that wait for a time or for a worker, and drained workers, in the API and on the page.

use std::collections::HashMap;

use api::Options;
use axum::http::StatusCode;
use serde_json::{Value, json};
use spec::{JobKind, Moment, Resources};

use crate::fixture::{Server, small_pipeline, small_simulation};
use crate::resources::worker;

fn with_execution(mut spec: Value, execution: Value) -> Value {
    spec["execution"] = execution;
    spec
}

/// The time this many hours from now, by the server's clock.
async fn hours_ahead(server: &Server, hours: i64) -> String {
    let now = server.store.now().await.unwrap().milliseconds();
    Moment::from_milliseconds(now + hours * 3_600_000).to_string()
}

#[tokio::test]
async fn a_job_that_no_worker_can_take_says_so_everywhere() {
    let server = Server::start().await;
    server.store.register_worker(&worker()).await.unwrap();
    let resources = json!({"gpus": 2, "tags": ["a100"]});
    let spec = with_execution(small_simulation(1), json!({"resources": resources}));
    let job = server.submitted(&spec).await;
    let expected = "no worker offers gpus >= 2 and tag a100; start one with `torqued worker --gpus 2 --tag a100`";
    assert_eq!(job["waits_for"], expected);
    let asked = json!({"cpus": null, "gpus": 2, "memory_gb": null, "tags": ["a100"]});
    assert_eq!(job["resources"], asked);
    let listed = server.json("/v1/jobs").await;
    assert_eq!(listed["jobs"][0]["waits_for"], expected);
    for path in ["/", "/jobs/1", "/workers"] {
        let answer = server.get(path).await;
        assert!(answer.text().contains("--gpus 2 --tag a100"), "{path}: {}", answer.text());
    }
    let health = server.json("/healthz").await;
    assert_eq!(health["status"], "degraded", "{health}");
    assert!(health["reasons"][0].as_str().unwrap().ends_with(expected), "{health}");

    // An engine provides missing workers.
    let engine = store::Engine { name: "Slurm".to_owned(), obstacle: None };
    server.store.set_engine(Some(&engine)).await.unwrap();
    assert_eq!(server.json("/healthz").await["status"], "ok");
    let asked = "no worker offers gpus >= 2 and tag a100; Slurm is asked for one";
    assert_eq!(server.json("/v1/jobs/1").await["waits_for"], asked);
    let obstacle = Some("Slurm's squeue failed".to_owned());
    let engine = store::Engine { obstacle, ..engine };
    server.store.set_engine(Some(&engine)).await.unwrap();
    let health = server.json("/healthz").await;
    assert_eq!(health["reasons"], json!(["Slurm's squeue failed"]));
    server.store.set_engine(None).await.unwrap();

    // This job can be executed: the server is well, and the other job still waits.
    server.submitted(&small_simulation(2)).await;
    assert_eq!(server.json("/healthz").await["status"], "ok");
    assert_eq!(server.json("/v1/jobs/1").await["waits_for"], expected);

    let mut larger = worker();
    larger.offers = Resources { gpus: 4, tags: ["a100".to_owned()].into(), ..Resources::default() };
    server.store.register_worker(&larger).await.unwrap();
    assert_eq!(server.json("/v1/jobs/1").await["waits_for"], json!(null));
    let listed = &server.json("/v1/workers").await["workers"][0];
    assert_eq!(
        (&listed["offers"]["gpus"], &listed["offers"]["tags"]),
        (&json!(4), &json!(["a100"]))
    );
}

#[tokio::test]
async fn a_member_of_a_pipeline_says_what_it_waits_for() {
    let server = Server::start().await;
    let mut pipeline = small_pipeline();
    let asked = json!({"resources": {"cpus": 1000}});
    pipeline["jobs"]["train-set"]["execution"] = asked;
    let pipeline = server.submitted(&pipeline).await;
    let members = pipeline["members"].as_array().unwrap();
    let waits = |member: &&Value| member["waits_for"].is_string();
    let waiting: Vec<_> = members.iter().filter(waits).map(|member| &member["name"]).collect();
    assert_eq!(waiting, ["train-set"], "{pipeline:#}");
    assert_eq!(pipeline["waits_for"], json!(null));
    let answer = server.get(&format!("/jobs/{}", pipeline["id"])).await;
    assert!(answer.text().contains("cpus &#62;= 1000"), "{}", answer.text());
}

#[tokio::test]
async fn a_job_that_may_not_begin_yet_says_from_when_on() {
    let server = Server::start().await;
    let moment = hours_ahead(&server, 5).await;
    let spec = with_execution(small_simulation(1), json!({"not_before": moment}));
    let job = server.submitted(&spec).await;
    assert_eq!((&job["state"], &job["not_before"]), (&json!("queued"), &json!(moment)));
    assert_eq!(job["waits_for"], format!("from {moment} on"));
    assert!(server.get("/jobs/1").await.text().contains(&format!("from {moment} on")));
    assert!(server.get("/").await.text().contains(&format!("from {moment} on")));
    assert!(server.claim().await.is_none());

    let passed = hours_ahead(&server, -5).await;
    let spec = with_execution(small_simulation(2), json!({"not_before": passed}));
    assert_eq!(server.submitted(&spec).await["waits_for"], json!(null));
    assert!(server.claim().await.is_some());

    let far = hours_ahead(&server, 24 * 366 + 1).await;
    for (not_before, part) in [(far.as_str(), "366 days ahead"), ("2026-12-01", "with its zone")] {
        let spec = with_execution(small_simulation(3), json!({"not_before": not_before}));
        let problem = server.submit(&spec).await.problem(422);
        let violation = &problem["violations"][0];
        assert_eq!(violation["field"], "execution.not_before");
        assert!(violation["allowed"].as_str().unwrap().contains(part), "{violation}");
    }
}

#[tokio::test]
async fn a_time_limit_of_a_kind_is_its_default_and_its_maximum() {
    let time_limits_s = HashMap::from([(JobKind::Simulate, 600)]);
    let server = Server::start_with(&Options { time_limits_s, ..Options::default() }).await;
    assert_eq!(server.submitted(&small_simulation(1)).await["time_limit_s"], 600);
    let task = server.claim().await.unwrap();
    assert_eq!(task.time_limit.unwrap().as_secs(), 600);
    let asking = |seconds| with_execution(small_simulation(2), json!({"time_limit_s": seconds}));
    assert_eq!(server.submitted(&asking(30)).await["time_limit_s"], 30);
    let pipeline = json!({"kind": "pipeline", "name": "p", "jobs": {"long": asking(601), "short": asking(600)}});
    for (spec, field) in
        [(asking(601), "execution.time_limit_s"), (pipeline, "jobs.long.execution.time_limit_s")]
    {
        let problem = server.submit(&spec).await.problem(422);
        assert_eq!(problem["violations"].as_array().unwrap().len(), 1, "{problem}");
        let violation = &problem["violations"][0];
        assert_eq!((&violation["field"], &violation["value"]), (&json!(field), &json!("601")));
        assert!(violation["allowed"].as_str().unwrap().starts_with("at most 600, "), "{violation}");
    }
}

#[tokio::test]
async fn a_worker_is_drained_and_undrained_by_its_name() {
    let server = Server::start().await;
    server.post("/v1/workers/w1/drain").await.problem(404);
    server.store.register_worker(&worker()).await.unwrap();
    server.submitted(&small_simulation(1)).await;
    assert!(server.get("/workers").await.text().contains(r#"action="./workers/w1/drain""#));
    for _ in 0..2 {
        let answer = server.post("/v1/workers/w1/drain").await;
        assert_eq!(answer.status, 200, "{answer:?}");
        assert!(answer.json()["drained_at"].is_string(), "{answer:?}");
    }
    let health = server.json("/healthz").await;
    assert_eq!(health["status"], "degraded");
    assert!(health["reasons"][0].as_str().unwrap().contains("every worker is drained"), "{health}");
    let page = server.get("/workers").await.text().to_owned();
    assert!(page.contains("drained: it claims no task"), "{page}");
    assert!(page.contains(r#"action="./workers/w1/undrain""#), "{page}");

    let answer = server.post("/workers/w1/undrain").await;
    assert_eq!((answer.status, answer.header("location")), (StatusCode::SEE_OTHER, "/workers"));
    assert_eq!(server.json("/v1/workers").await["workers"][0]["drained_at"], json!(null));
    assert_eq!(server.json("/healthz").await["status"], "ok");
    assert_eq!(server.post("/v1/workers/w1/undrain").await.status, 200);
    assert_eq!(server.post("/workers/w1/drain").await.status, StatusCode::SEE_OTHER);
}
