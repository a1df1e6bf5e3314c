//! Refused requests and their errors.

use api::Options;
use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, HOST};
use axum::http::{Method, Request};
use serde_json::json;

use crate::fixture::{Server, small_simulation};

async fn post(
    server: &Server,
    content_type: Option<&str>,
    body: impl Into<Body>,
) -> crate::fixture::TestResponse {
    let mut request = Request::post("/v1/jobs").header(HOST, "localhost");
    if let Some(content_type) = content_type {
        request = request.header(CONTENT_TYPE, content_type);
    }
    server.send(request.body(body.into()).unwrap()).await
}

#[tokio::test]
async fn every_violation_of_a_spec_is_told_with_field_value_and_range() {
    let server = Server::start().await;
    let spec = json!({"preset": "D1-chirp", "samples": 0, "rejection": {"max_draws": 0}});
    let problem = server.submit(&spec).await.problem(422);
    let fields: Vec<_> = problem["violations"]
        .as_array()
        .unwrap()
        .iter()
        .map(|violation| violation["field"].as_str().unwrap())
        .collect();
    assert_eq!(fields, ["samples", "rejection.max_draws"]);
    assert_eq!(problem["violations"][0]["value"], "0");
    assert!(problem["violations"][0]["allowed"].as_str().unwrap().contains(" to "));
}

#[tokio::test]
async fn a_simulation_beyond_the_servers_limit_is_refused_also_in_a_pipeline() {
    let options = Options { max_trajectories: 1000, ..Options::default() };
    let server = Server::start_with(&options).await;
    let simulation =
        |trajectories: u64| json!({"preset": "D1-chirp", "trajectories": trajectories});
    server.submitted(&simulation(1000)).await;
    let problem = server.submit(&simulation(1001)).await.problem(422);
    let violation = &problem["violations"][0];
    assert_eq!(
        (&violation["field"], &violation["value"]),
        (&json!("trajectories"), &json!("1001"))
    );
    assert!(violation["allowed"].as_str().unwrap().starts_with("at most 1000, "), "{violation}");

    let jobs = json!({"small": simulation(10), "large": simulation(5000)});
    let pipeline = json!({"kind": "pipeline", "name": "sizes", "jobs": jobs});
    let problem = server.submit(&pipeline).await.problem(422);
    let violations = problem["violations"].as_array().unwrap();
    assert_eq!((violations.len(), &violations[0]["field"]), (1, &json!("jobs.large.trajectories")));

    let mut stream = simulation(1_000_000_000);
    stream["kind"] = json!("simulate");
    server.submitted(&crate::fixture::small_training(&json!({"stream": stream}))).await;
}

#[tokio::test]
async fn an_unknown_field_and_an_unknown_preset_are_refused() {
    let server = Server::start().await;
    let problem =
        server.submit(&json!({"preset": "D1-chirp", "trajectorys": 5})).await.problem(422);
    assert!(problem["detail"].as_str().unwrap().contains("trajectorys"));
    let problem = server.submit(&json!({"preset": "D9"})).await.problem(422);
    assert!(problem["violations"][0]["allowed"].as_str().unwrap().contains("quickstart"));
}

#[tokio::test]
async fn a_body_that_is_not_json_is_refused() {
    let server = Server::start().await;
    for body in ["", "{", "\u{0}", "NaN", "{\"kind\": NaN}"] {
        post(&server, Some("application/json"), body).await.problem(400);
    }
    for body in ["[]", "3", "\"simulate\"", "null"] {
        post(&server, Some("application/json"), body).await.problem(422);
    }
    let deep = "[".repeat(100_000);
    post(&server, Some("application/json"), deep).await.problem(400);
}

#[tokio::test]
async fn a_body_of_another_type_is_refused_with_the_type_to_send() {
    let server = Server::start().await;
    let text = small_simulation(1).to_string();
    for content_type in [None, Some("text/plain"), Some("application/x-www-form-urlencoded")] {
        let problem = post(&server, content_type, text.clone()).await.problem(415);
        assert!(problem["detail"].as_str().unwrap().contains("application/json"));
    }
    let accepted = post(&server, Some("application/json; charset=utf-8"), text).await;
    assert!(accepted.status.is_success());
}

#[tokio::test]
async fn a_body_of_more_than_a_mebibyte_is_refused() {
    let server = Server::start().await;
    let body = format!("\"{}\"", "x".repeat(api::limits::BODY_BYTES));
    let problem = post(&server, Some("application/json"), body).await.problem(413);
    assert!(problem["detail"].as_str().unwrap().contains("1048576"));
}

#[tokio::test]
async fn what_does_not_exist_is_not_found() {
    let server = Server::start().await;
    for path in [
        "/nothing",
        "/v1",
        "/v1/jobs/1",
        "/v1/jobs/-1",
        "/v1/jobs/1/tasks",
        "/v1/datasets/1",
        "/v1/datasets/1/files/trajectories-00000.parquet",
        "/v1/runs/1",
        "/v1/runs/1/metrics/loss",
        "/v1/runs/1/metrics/train/loss",
        "/v1/runs/1/artifacts/rmse-multisine.svg",
        "/v1/runs/1/figures/loss.svg",
        "/v1/checkpoints/1",
        "/v1/checkpoints/1/files/config.json",
        "/v1/evaluations/1",
        "/static/page.html",
    ] {
        server.get(path).await.problem(404);
    }
    server.post("/v1/jobs/1/cancel").await.problem(404);
}

#[tokio::test]
async fn names_that_an_existing_thing_does_not_have_are_not_found() {
    let server = Server::start().await;
    server.submitted(&crate::fixture::small_pipeline()).await;
    server.work().await;
    for path in [
        "/v1/datasets/1/files/trajectories-00009.parquet",
        "/v1/datasets/1/files/..%2f..%2ftorqued.sqlite",
        "/v1/checkpoints/1/files/secrets",
        "/v1/runs/1/artifacts/nothing",
        "/v1/runs/1/figures/gain.svg",
        "/v1/runs/1/metrics/train/nothing",
        "/v1/evaluations/1",
    ] {
        server.get(path).await.problem(404);
    }
}

#[tokio::test]
async fn an_id_that_is_no_number_is_refused() {
    let server = Server::start().await;
    for path in ["/v1/jobs/x", "/v1/jobs/1.5", "/v1/runs/99999999999999999999", "/v1/datasets/%00"]
    {
        server.get(path).await.problem(400);
    }
}

#[tokio::test]
async fn a_query_that_is_not_understood_is_refused() {
    let server = Server::start().await;
    for query in [
        "stat=running",
        "state=walking",
        "kind=export",
        "limit=0",
        "limit=501",
        "limit=x",
        "limit=1&limit=2",
        "before=x",
        "&&x",
    ] {
        server.get(&format!("/v1/jobs?{query}")).await.problem(400);
    }
    server.get("/v1/presets?name=D1").await.problem(400);
    server.get("/v1/jobs/1?verbose=1").await.problem(400);
    let problem = server.get("/v1/datasets?stat=complete").await.problem(400);
    assert!(problem["detail"].as_str().unwrap().contains("kind, state, tag, text"));
    let forced = server.submit_to("/v1/jobs?force=yes", &small_simulation(1), &[]).await;
    forced.problem(400);
}

#[tokio::test]
async fn a_method_that_a_path_does_not_answer_is_refused() {
    let server = Server::start().await;
    for (method, path) in [
        (Method::DELETE, "/v1/jobs"),
        (Method::GET, "/v1/jobs/1/cancel"),
        (Method::POST, "/healthz"),
        (Method::PUT, "/"),
    ] {
        let answer = server.request(method, path, &[]).await;
        answer.problem(405);
        assert!(!answer.header("allow").is_empty());
    }
}

#[tokio::test]
async fn a_job_that_has_ended_by_itself_is_neither_cancelled_nor_tried_again() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    server.work().await;
    let retried = server.post(&format!("/v1/jobs/{}/retry", job["id"])).await.problem(409);
    assert!(
        retried["detail"].as_str().unwrap().contains("only failed and cancelled jobs"),
        "{retried}"
    );
    let problem = server.post(&format!("/v1/jobs/{}/cancel", job["id"])).await.problem(409);
    assert!(problem["detail"].as_str().unwrap().contains("succeeded"));
}
