//! The buttons of pages that verify a dataset, cancel a job and submit one again.

use axum::http::Method;
use serde_json::json;

use crate::fixture::{Server, small_pipeline, small_simulation, small_training};
use crate::pages::page;

#[tokio::test]
async fn the_button_verifies_and_the_page_tells_the_outcome() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    assert!(!page(&server, "/datasets/1").await.contains("/datasets/1/verify"));
    assert_eq!(server.post("/datasets/1/verify").await.status, 409);
    server.work().await;
    let answer = server.post("/datasets/1/verify").await;
    let outcome = "/datasets/1#verification";
    assert_eq!((answer.status.as_u16(), answer.header("location")), (303, outcome));
    let task = server.claim().await.unwrap();
    let result = json!({"shard": 0, "dataset": 1, "bytes": "equal"});
    server.store.complete(task.fence, Some(&result)).await.unwrap();
    for path in ["/datasets/1", "/", &format!("/jobs/{}", task.job)] {
        let page = page(&server, path).await;
        assert!(page.contains("the one shard agrees in every byte"), "{path}: {page}");
    }
    assert!(page(&server, "/").await.contains(outcome));
}

#[tokio::test]
async fn the_button_cancels_and_leads_back() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    let path = format!("/jobs/{}", job["id"]);
    for _ in 0..2 {
        let answer = server.post(&format!("{path}/cancel")).await;
        assert_eq!((answer.status.as_u16(), answer.header("location")), (303, path.as_str()));
    }
    assert!(page(&server, &path).await.contains("cancelled"));
}

/// A press on Cancel ended a training of days at once.
#[tokio::test]
async fn cancelling_asks_first_and_says_what_is_lost() {
    let server = Server::start().await;
    let simulation = server.submitted(&small_simulation(1)).await;
    let path = format!("/jobs/{}", simulation["id"]);
    let link = format!("href=\"..{path}/cancel\"");
    assert!(page(&server, &path).await.contains(&link));
    let question = page(&server, &format!("{path}/cancel")).await;
    assert!(
        question.contains("nothing is lost") && question.contains("Let it go on"),
        "{question}"
    );
    assert!(question.contains(&format!("action=\"../..{path}/cancel\"")), "{question}");
    assert_eq!(server.json(&format!("/v1{path}")).await["state"], "queued");

    let training = server.submitted(&small_training(&json!({"dataset": 1}))).await;
    let question = page(&server, &format!("{path}/cancel")).await;
    let waiting = format!("href=\"../../jobs/{}\"", training["id"]);
    assert!(
        question.contains("Jobs that wait for it") && question.contains(&waiting),
        "{question}"
    );
    // A job that has ended is shown.
    let task = server.claim().await.unwrap();
    server.finish(&task).await;
    let answer = server.get(&format!("{path}/cancel")).await;
    assert_eq!((answer.status.as_u16(), answer.header("location")), (303, path.as_str()));
    assert_eq!(server.get("/jobs/99/cancel").await.status, 404);
}

#[tokio::test]
async fn cancelling_a_pipeline_lists_its_open_jobs() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    let question = page(&server, &format!("/jobs/{}/cancel", pipeline["id"])).await;
    for part in
        ["Jobs of it that have not ended", "train-set", "evaluate", "Cancel this pipeline job"]
    {
        assert!(question.contains(part), "{part}: {question}");
    }
    assert!(!question.contains("Jobs that wait for it"), "{question}");
}

#[tokio::test]
async fn a_failed_job_has_a_button_that_submits_it_again() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    let path = format!("/jobs/{}", job["id"]);
    let button = format!("{path}/retry\"");
    for shown in ["/", &path] {
        assert!(!page(&server, shown).await.contains(&button), "{shown}");
    }
    // Its reader saw an older page.
    let answer = server.post(&format!("{path}/retry")).await;
    assert_eq!((answer.status.as_u16(), answer.header("location")), (303, path.as_str()));

    server.fail_next("the disk is full").await;
    for shown in ["/", &path, "/datasets/1"] {
        let page = page(&server, shown).await;
        assert!(page.contains(&button) && !page.contains("Cancel"), "{shown}: {page}");
    }
    let answer = server.post(&format!("{path}/retry")).await;
    assert_eq!(answer.status, 303);
    let again = answer.header("location").to_owned();
    assert_ne!(again, path);
    assert!(page(&server, &again).await.contains("queued"));
}

#[tokio::test]
async fn the_button_to_retry_is_as_guarded_as_the_one_to_cancel() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    server.fail_next("the disk is full").await;
    for button in ["cancel", "retry"] {
        let path = format!("/jobs/{}/{button}", job["id"]);
        let strange = [("origin", "https://evil.example"), ("sec-fetch-site", "cross-site")];
        let answer = server.request(Method::POST, &path, &strange).await;
        assert_eq!(answer.status, 403, "{path}");
    }
    assert_eq!(server.json("/v1/jobs").await["jobs"].as_array().unwrap().len(), 1);
}
