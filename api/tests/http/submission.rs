//! Submissions: new jobs, reused jobs, and equal specs.

use api::Options;
use axum::http::StatusCode;
use serde_json::json;

use crate::fixture::{Server, small_pipeline, small_simulation, small_training};

#[tokio::test]
async fn a_new_job_is_created_with_its_place_and_its_tasks() {
    let server = Server::start().await;
    let answer = server.submit(&small_simulation(1)).await;
    assert_eq!(answer.status, StatusCode::CREATED);
    let job = answer.json();
    assert_eq!(answer.header("location"), format!("/v1/jobs/{}", job["id"]));
    assert_eq!((job["kind"].as_str(), job["state"].as_str()), (Some("simulate"), Some("queued")));
    let digest = job["digest"].as_str().unwrap();
    assert_eq!(job["name"], format!("simulate-{}", &digest[..12]));
    assert_eq!(job["progress"]["total"], 10);
    assert_eq!(job["spec"]["samples"], 400);
    let tasks = server.json(&format!("/v1/jobs/{}/tasks", job["id"])).await;
    assert_eq!(tasks["tasks"][0]["label"], "shard 00000");
}

#[tokio::test]
async fn a_spec_that_was_submitted_before_returns_the_same_job() {
    let server = Server::start().await;
    let first = server.submitted(&small_simulation(1)).await;
    let same = json!({"seed": 1, "trajectories": 10, "preset": "D1-multisine",
                      "execution": {"priority": 5}});
    let again = server.submit(&same).await;
    assert_eq!(again.status, StatusCode::OK);
    assert_eq!(again.json()["id"], first["id"]);
    server.work().await;
    assert_eq!(server.submit(&same).await.json()["state"], "succeeded");
}

#[tokio::test]
async fn a_job_that_failed_is_computed_anew() {
    let server = Server::start().await;
    let first = server.submitted(&small_simulation(1)).await;
    server.fail_next("no luck").await;
    let second = server.submitted(&small_simulation(1)).await;
    assert_ne!(second["id"], first["id"]);
}

#[tokio::test]
async fn force_computes_anew_what_was_already_done() {
    let server = Server::start().await;
    let first = server.submitted(&small_simulation(1)).await;
    server.work().await;
    let forced = server.submit_to("/v1/jobs?force=true", &small_simulation(1), &[]).await;
    assert_eq!(forced.status, StatusCode::CREATED);
    assert_ne!(forced.json()["id"], first["id"]);
    assert_eq!(forced.json()["digest"], first["digest"]);
}

#[tokio::test]
async fn a_pipeline_is_submitted_whole_and_runs_to_its_end() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    assert_eq!(
        (pipeline["name"].as_str(), pipeline["kind"].as_str()),
        (Some("quickstart"), Some("pipeline"))
    );
    let members = pipeline["members"].as_array().unwrap();
    let names: Vec<_> = members.iter().map(|member| member["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["test-grid", "train-set", "train", "evaluate"]);
    let states: Vec<_> = members.iter().map(|member| member["state"].as_str().unwrap()).collect();
    assert_eq!(states, ["queued", "queued", "waiting", "waiting"]);
    assert!(members.iter().all(|member| member["reused"] == false));
    let train = server.json(&format!("/v1/jobs/{}", members[2]["job"])).await;
    let pipelines = json!([{"id": pipeline["id"], "name": "quickstart", "member": "train"}]);
    assert_eq!(train["pipelines"], pipelines);

    server.work().await;
    for path in ["/jobs/1", "/datasets/1", "/runs/1", "/checkpoints/1", "/evaluations/4"] {
        let page = server.get(path).await.text().to_owned();
        let link = format!("jobs/{}\" title=\"The pipeline", pipeline["id"]);
        assert!(page.contains(&link) && page.contains("quickstart / "), "{path}: {page}");
    }

    let pipeline = server.json(&format!("/v1/jobs/{}", pipeline["id"])).await;
    assert_eq!(pipeline["state"], "succeeded");
    assert_eq!(
        (&pipeline["progress"]["done"], &pipeline["progress"]["total"]),
        (&json!(4), &json!(4))
    );
}

#[tokio::test]
async fn a_stored_spec_refers_by_digest_alone() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    let member = async |name: &str| {
        let members = pipeline["members"].as_array().unwrap();
        let member = members.iter().find(|member| member["name"] == name).unwrap();
        server.json(&format!("/v1/jobs/{}", member["job"])).await
    };
    let (data, grid) = (member("train-set").await, member("test-grid").await);
    let (train, evaluate) = (member("train").await, member("evaluate").await);
    assert_eq!(train["spec"]["data"], json!({"digest": data["digest"]}));
    assert_eq!(train["needs"], json!([data["id"]]));
    assert_eq!(evaluate["spec"]["data"], json!({"digest": grid["digest"]}));
    assert_eq!(evaluate["spec"]["checkpoints"], json!([{"digest": train["digest"]}]));
    assert_eq!(evaluate["needs"].as_array().unwrap().len(), 2);
    assert_eq!(pipeline["spec"]["jobs"]["train"]["data"], json!({"digest": data["digest"]}));
}

#[tokio::test]
async fn a_pipeline_takes_over_the_members_that_exist() {
    let server = Server::start().await;
    let first = server.submitted(&small_pipeline()).await;
    server.work().await;
    assert_eq!(server.submit(&small_pipeline()).await.json()["id"], first["id"]);

    let mut changed = small_pipeline();
    changed["jobs"]["train"]["steps"] = json!(200);
    let second = server.submitted(&changed).await;
    let reused: Vec<_> = second["members"]
        .as_array()
        .unwrap()
        .iter()
        .map(|member| (member["name"].as_str().unwrap(), member["reused"] == true))
        .collect();
    let expected =
        [("test-grid", true), ("train-set", true), ("train", false), ("evaluate", false)];
    assert_eq!(reused, expected);
}

#[tokio::test]
async fn explicit_needs_are_waited_for() {
    let server = Server::start().await;
    let pipeline = server
        .submitted(&json!({"kind": "pipeline", "name": "two", "jobs": {
            "first": small_simulation(1),
            "second": {"preset": "D1-chirp", "trajectories": 10, "needs": ["first"]},
        }}))
        .await;
    let second = &pipeline["members"][1];
    assert_eq!((&second["name"], &second["state"]), (&json!("second"), &json!("waiting")));
}

#[tokio::test]
async fn an_idempotency_key_names_one_request() {
    let server = Server::start().await;
    let key = [("idempotency-key", "7b6a")];
    let send =
        async |path: &str, seed: u64| server.submit_to(path, &small_simulation(seed), &key).await;
    let path = "/v1/jobs?force=true";
    let first = send(path, 1).await;
    let again = send(path, 1).await;
    assert_eq!(again.json()["id"], first.json()["id"]);
    let other_spec = send(path, 2).await.problem(422);
    assert!(other_spec["detail"].as_str().unwrap().contains("7b6a"));
    send("/v1/jobs", 1).await.problem(422);
    for bad in ["", &"x".repeat(256)] {
        let answer =
            server.submit_to(path, &small_simulation(1), &[("idempotency-key", bad)]).await;
        answer.problem(400);
    }
}

/// Regression: the repeat of an accepted request was refused after its dataset was deleted, or a
/// limit was lowered.
#[tokio::test]
async fn a_repeated_request_is_answered_whatever_has_changed_since() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    let key = [("idempotency-key", "first")];
    let training = small_training(&json!({"digest": data["digest"]}));
    let first = server.submit_to("/v1/jobs", &training, &key).await;
    assert_eq!(first.status, StatusCode::CREATED, "{first:?}");
    server.fail_next("the disk is gone").await;
    server.submit(&training).await.problem(422);

    let large = [("idempotency-key", "second")];
    let simulation = small_simulation(2);
    let second = server.submit_to("/v1/jobs", &simulation, &large).await;
    let server = server.restarted_with(&Options { max_trajectories: 5, ..Options::default() });
    server.submit(&simulation).await.problem(422);

    for (spec, key, before) in [(&training, &key, first), (&simulation, &large, second)] {
        let again = server.submit_to("/v1/jobs", spec, key).await;
        assert_eq!(again.status, StatusCode::CREATED, "{again:?}");
        assert_eq!(again.json()["id"], before.json()["id"]);
        server.submit_to("/v1/jobs", &small_simulation(3), key).await.problem(422);
    }
}
