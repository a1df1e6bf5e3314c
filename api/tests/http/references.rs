//! References by id, by digest and by name, and invalid ones.

use serde_json::{Value, json};

use crate::fixture::{Server, small_pipeline, small_simulation, small_training};

/// The only violation of a spec that must be refused.
async fn violation(server: &Server, spec: &Value) -> Value {
    let before = server.json("/v1/jobs").await["jobs"].as_array().unwrap().len();
    let problem = server.submit(spec).await.problem(422);
    let after = server.json("/v1/jobs").await["jobs"].as_array().unwrap().len();
    assert_eq!(before, after, "something was queued");
    let violations = problem["violations"].as_array().unwrap();
    assert_eq!(violations.len(), 1, "{problem}");
    violations[0].clone()
}

#[tokio::test]
async fn a_dataset_is_referred_to_by_id_or_digest() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    let by_id = server.submitted(&small_training(&json!({"dataset": data["dataset"]}))).await;
    assert_eq!(by_id["spec"]["data"], json!({"digest": data["digest"]}));
    assert_eq!(by_id["state"], "waiting");
    let by_digest = server.submit(&small_training(&json!({"digest": data["digest"]}))).await;
    assert_eq!(by_digest.json()["id"], by_id["id"]);
}

#[tokio::test]
async fn a_checkpoint_stands_for_the_last_one_of_its_training() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    server.work().await;
    let checkpoint = &server.json("/v1/checkpoints").await["checkpoints"][0];
    let members = pipeline["members"].as_array().unwrap();
    let grid = members.iter().find(|member| member["name"] == "test-grid").unwrap();
    let grid = server.json(&format!("/v1/jobs/{}", grid["job"])).await;
    let evaluation = server
        .submitted(&json!({
            "kind": "evaluate", "data": {"dataset": grid["dataset"]},
            "checkpoints": [{"checkpoint": checkpoint["id"]}], "baselines": ["hold-last"],
        }))
        .await;
    assert_eq!(evaluation["spec"]["checkpoints"], json!([{"digest": checkpoint["digest"]}]));
    assert_eq!(evaluation["state"], "queued");
}

#[tokio::test]
async fn a_dataset_that_does_not_exist_is_named_with_those_that_do() {
    let server = Server::start().await;
    let spec = small_training(&json!({"dataset": 99}));
    let none = violation(&server, &spec).await;
    assert_eq!((&none["field"], &none["value"]), (&json!("data.dataset"), &json!("99")));
    assert!(none["allowed"].as_str().unwrap().contains("none yet"));

    let data = server.submitted(&small_simulation(1)).await;
    let some = violation(&server, &spec).await;
    let allowed = format!("the id of a dataset, the newest are {}", data["dataset"]);
    assert_eq!(some["allowed"], allowed);
}

#[tokio::test]
async fn a_digest_of_nothing_is_named_with_those_that_exist() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    let missing = "0".repeat(64);
    let found = violation(&server, &small_training(&json!({"digest": missing}))).await;
    assert_eq!((&found["field"], &found["value"]), (&json!("data.digest"), &json!(missing)));
    assert!(found["allowed"].as_str().unwrap().contains(data["digest"].as_str().unwrap()));
}

#[tokio::test]
async fn a_digest_of_another_kind_of_job_is_refused() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    let spec = json!({"kind": "evaluate", "data": {"digest": data["digest"]},
                      "checkpoints": [{"digest": data["digest"]}]});
    let found = violation(&server, &spec).await;
    assert_eq!(found["field"], "checkpoints[0].digest");
}

#[tokio::test]
async fn data_of_a_job_that_failed_is_refused() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    server.fail_next("no luck").await;
    let spec = small_training(&json!({"dataset": data["dataset"]}));
    let found = violation(&server, &spec).await;
    assert_eq!(found["field"], "data.dataset");
    assert!(found["value"].as_str().unwrap().ends_with("which failed"), "{found}");

    server.submitted(&small_simulation(1)).await;
    server.submitted(&spec).await;
}

#[tokio::test]
async fn data_of_a_job_that_was_cancelled_is_refused() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    server.post(&format!("/v1/jobs/{}/cancel", data["id"])).await;
    let found = violation(&server, &small_training(&json!({"digest": data["digest"]}))).await;
    assert!(found["value"].as_str().unwrap().ends_with("which was cancelled"), "{found}");
}

#[tokio::test]
async fn a_training_that_does_not_fit_its_data_is_refused() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    let mut spec = small_training(&json!({"dataset": data["dataset"]}));
    spec["batch_size"] = json!(64);
    let found = violation(&server, &spec).await;
    assert_eq!((&found["field"], &found["value"]), (&json!("batch_size"), &json!("64")));
}

#[tokio::test]
async fn an_evaluation_needs_a_training_of_the_same_shape() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    let reference = json!({"digest": data["digest"]});
    let train = server.submitted(&small_training(&reference)).await;
    let spec = json!({
        "kind": "pipeline", "name": "mismatch", "jobs": {
            "grid": {"preset": "grid-chirp", "samples": 500},
            "evaluate": {"kind": "evaluate", "data": {"job": "grid"},
                         "checkpoints": [{"digest": train["digest"]}]},
        },
    });
    let found = violation(&server, &spec).await;
    assert_eq!(found["field"], "jobs.evaluate.checkpoints[0]");
    assert_eq!(found["value"], "trained with samples 400");
}

#[tokio::test]
async fn a_training_is_not_evaluated_twice_under_two_names() {
    let server = Server::start().await;
    server.submitted(&small_pipeline()).await;
    server.work().await;
    let checkpoint = &server.json("/v1/checkpoints").await["checkpoints"][0];
    let spec = json!({
        "kind": "pipeline", "name": "twice", "jobs": {
            "grid": {"preset": "grid-chirp"},
            "evaluate": {"kind": "evaluate", "data": {"job": "grid"}, "checkpoints": [
                {"checkpoint": checkpoint["id"]}, {"digest": checkpoint["digest"]},
            ]},
        },
    });
    assert_eq!(violation(&server, &spec).await["field"], "jobs.evaluate.checkpoints[1]");
}
