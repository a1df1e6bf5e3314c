//! Verifications of datasets and their results.

use serde_json::{Value, json};
use store::Retry;

use crate::fixture::{Server, small_simulation};

/// A server with one complete dataset of two shards.
async fn with_dataset() -> Server {
    let server = Server::start().await;
    let spec = json!({"preset": "D1-multisine", "trajectories": 20, "shard_trajectories": 10});
    server.submitted(&spec).await;
    server.work().await;
    server
}

async fn verification(server: &Server) -> Value {
    server.json("/v1/datasets/1").await["verification"].clone()
}

#[tokio::test]
async fn a_verification_is_a_new_job_each_time_and_names_the_dataset() {
    let server = with_dataset().await;
    assert_eq!(verification(&server).await, json!(null));
    let first = server.post("/v1/datasets/1/verify").await;
    assert_eq!(first.status, 202, "{first:?}");
    let job = first.json();
    assert_eq!(first.header("location"), format!("/v1/jobs/{}", job["id"]));
    assert_eq!((&job["kind"], &job["state"]), (&json!("verify"), &json!("queued")));
    assert_eq!((&job["name"], &job["verifies"]), (&json!("verify-dataset-1"), &json!(1)));
    let tasks = server.store.tasks(store::JobId(job["id"].as_i64().unwrap())).await.unwrap();
    let payloads: Vec<_> = tasks.iter().map(|task| task.payload.clone()).collect();
    assert_eq!(payloads, [json!({"shard": 0, "dataset": 1}), json!({"shard": 1, "dataset": 1})]);
    assert_eq!(tasks[1].total, 10);

    server.work().await;
    let again = server.post("/v1/datasets/1/verify").await.json();
    assert_ne!(again["id"], job["id"]);
    let submitted = server.submit(&json!({"kind": "verify", "data": {"dataset": 1}})).await;
    assert_eq!(submitted.status, 201, "{submitted:?}");
}

#[tokio::test]
async fn of_two_datasets_with_one_digest_the_one_that_is_named_is_verified() {
    let server = with_dataset().await;
    let spec = json!({"preset": "D1-multisine", "trajectories": 20, "shard_trajectories": 10});
    server.submit_to("/v1/jobs?force=true", &spec, &[]).await;
    server.work().await;
    let jobs = [
        server.post("/v1/datasets/1/verify").await.json(),
        server.submit(&json!({"kind": "verify", "data": {"dataset": 2}})).await.json(),
    ];
    for (job, dataset) in jobs.iter().zip([1, 2]) {
        assert_eq!(job["verifies"], dataset);
        let dataset = server.json(&format!("/v1/datasets/{dataset}")).await;
        assert_eq!(dataset["verification"]["job"], job["id"]);
    }
}

#[tokio::test]
async fn a_dataset_tells_what_its_newest_verification_found() {
    let server = with_dataset().await;
    let job = server.post("/v1/datasets/1/verify").await.json();
    let results = [
        json!({"shard": 0, "dataset": 1, "bytes": "equal"}),
        json!({"shard": 1, "dataset": 1, "bytes": "differ, written by version 0.0.9", "values": "equal"}),
    ];
    let task = server.claim().await.unwrap();
    server.store.complete(task.fence, Some(&results[0])).await.unwrap();
    let tasks = server.json(&format!("/v1/jobs/{}/tasks", job["id"])).await;
    assert_eq!(tasks["tasks"][0]["result"], results[0]);
    let simulated = server.json("/v1/jobs/1/tasks").await;
    assert_eq!(simulated["tasks"][0]["result"], json!(null));
    let halfway = verification(&server).await;
    assert_eq!((&halfway["state"], &halfway["shards_verified"]), (&json!("running"), &json!(1)));
    let task = server.claim().await.unwrap();
    server.store.complete(task.fence, Some(&results[1])).await.unwrap();
    let mut found = verification(&server).await;
    assert!(found["finished_at"].take().is_string());
    let expected = json!({
        "job": job["id"], "state": "succeeded", "shards": 2, "shards_verified": 2,
        "shards_identical": 1, "error": null, "finished_at": null,
        "remarks": ["shard 00001: bytes differ, written by version 0.0.9, values equal"],
    });
    assert_eq!(found, expected);

    server.post("/v1/datasets/1/verify").await;
    let task = server.claim().await.unwrap();
    let difference = "trajectory 3, column q2, step 17: stored 0.5, made again 0.25";
    server.store.fail(task.fence, difference, Retry::Never).await.unwrap();
    let found = verification(&server).await;
    assert_eq!((&found["state"], &found["shards_verified"]), (&json!("failed"), &json!(0)));
    assert!(found["error"].as_str().unwrap().contains(difference));
}

#[tokio::test]
async fn a_dataset_that_lacks_shards_cannot_be_verified_yet() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    let problem = server.post("/v1/datasets/1/verify").await.problem(409);
    assert!(problem["detail"].as_str().unwrap().contains("job 1"), "{problem}");
    server.post("/v1/datasets/2/verify").await.problem(404);
    server.post("/v1/datasets/x/verify").await.problem(400);
    assert_eq!(server.json("/v1/jobs").await["jobs"].as_array().unwrap().len(), 1);
}
