//! The logs of attempts: in pages, while they grow, as a file and on the page of the job.

use std::time::Duration;

use axum::http::Method;
use serde_json::{Value, json};

use crate::fixture::{Server, small_pipeline, small_simulation};

/// A simulation of two shards.
fn two_shards() -> Value {
    json!({"preset": "D1-multisine", "trajectories": 20, "shard_trajectories": 10})
}

fn texts(page: &Value) -> Vec<&str> {
    page["chunks"].as_array().unwrap().iter().map(|chunk| chunk["text"].as_str().unwrap()).collect()
}

#[tokio::test]
async fn a_log_is_read_from_its_end_and_as_it_comes() {
    let server = Server::start().await;
    let job = server.submitted(&two_shards()).await["id"].clone();
    let path = format!("/v1/jobs/{job}/logs");
    let nothing = server.json(&path).await;
    assert_eq!(nothing, json!({"chunks": [], "next": 0, "previous": null, "complete": false}));

    let (first, second) = (server.claim().await.unwrap(), server.claim().await.unwrap());
    for k in 0..3 {
        server.log(&first, 2 * k, &format!("{k}\n")).await;
    }
    server.log(&second, 0, "other\n").await;
    let newest = server.json(&format!("{path}?limit=3")).await;
    assert_eq!(texts(&newest), ["1\n", "2\n", "other\n"]);
    let chunk = &newest["chunks"][2];
    assert_eq!((&chunk["label"], &chunk["worker"]), (&json!("shard 00001"), &json!("test-worker")));
    let before = server.json(&format!("{path}?limit=3&before={}", newest["previous"])).await;
    assert_eq!((texts(&before), &before["previous"]), (vec!["0\n"], &json!(null)));
    let after = server.json(&format!("{path}?after={}", before["next"])).await;
    assert_eq!((texts(&after), &after["complete"]), (texts(&newest), &json!(false)));
    let none = server.json(&format!("{path}?after={}", after["next"])).await;
    assert_eq!((texts(&none), &none["next"]), (vec![], &after["next"]));
}

#[tokio::test]
async fn a_reader_waits_for_the_next_lines_and_for_the_end() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await["id"].clone();
    let task = server.claim().await.unwrap();
    let path = format!("/v1/jobs/{job}/logs?wait=20&after=");
    let reader = async { server.json(&format!("{path}0")).await };
    let worker = async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        server.log(&task, 0, "begins\n").await;
    };
    let (page, ()) = tokio::join!(reader, worker);
    assert_eq!((texts(&page), &page["complete"]), (vec!["begins\n"], &json!(false)));

    let next = page["next"].clone();
    let reader = async { server.json(&format!("{path}{next}")).await };
    let worker = async {
        tokio::time::sleep(Duration::from_millis(50)).await;
        server.store.fail(task.fence, "the arm fell off", store::Retry::Never).await.unwrap();
    };
    let (end, ()) = tokio::join!(reader, worker);
    assert_eq!(end, json!({"chunks": [], "next": next, "previous": null, "complete": true}));
    assert_eq!(server.json(&format!("/v1/jobs/{job}/logs")).await["complete"], true);
}

#[tokio::test]
async fn logs_are_told_apart_by_task_and_attempt() {
    let server = Server::start().await;
    let job = server.submitted(&two_shards()).await["id"].clone();
    server.submitted(&small_simulation(1)).await;
    let first = server.claim().await.unwrap();
    server.log(&first, 0, "first try\n").await;
    server.store.release(first.fence).await.unwrap();
    for text in ["second try\n", "other\n", "other job\n"] {
        let task = server.claim().await.unwrap();
        server.log(&task, 0, text).await;
    }
    let path = format!("/v1/jobs/{job}/logs");
    let of = async |query: &str| server.json(&format!("{path}?{query}")).await;
    let of_task = ["first try\n", "second try\n"];
    assert_eq!(texts(&of("task=shard%2000000").await), of_task);
    assert_eq!(texts(&of(&format!("task={}", first.fence.task)).await), of_task);
    assert_eq!(texts(&of("attempt=2").await), ["second try\n"]);
    assert_eq!(texts(&of("attempt=2&task=shard%2000000").await), ["second try\n"]);
    let refused = [
        "task=shard",
        "task=3",
        "task=99",
        "attempt=4",
        "attempt=99",
        "attempt=2&task=shard%2000001",
        "limit=0",
        "limit=101",
        "wait=1",
        "wait=21&after=1",
        "after=1&before=2",
        "after=x",
        "lines=3",
    ];
    for query in refused {
        server.get(&format!("{path}?{query}")).await.problem(400);
    }
    server.get("/v1/jobs/9/logs").await.problem(404);
}

#[tokio::test]
async fn a_pipeline_has_the_logs_of_its_jobs() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    let task = server.claim().await.unwrap();
    server.log(&task, 0, "of a member\n").await;
    let page = server.json(&format!("/v1/jobs/{}/logs", pipeline["id"])).await;
    assert_eq!((texts(&page), &page["complete"]), (vec!["of a member\n"], &json!(false)));
    server.finish(&task).await;
    server.work().await;
    let page = server.json(&format!("/v1/jobs/{}/logs", pipeline["id"])).await;
    assert_eq!(page["complete"], true);
}

#[tokio::test]
async fn the_log_of_an_attempt_downloads_as_text_with_its_gaps() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await["id"].clone();
    let attempts = format!("/v1/jobs/{job}/attempts");
    let task = server.claim().await.unwrap();
    assert_eq!(server.json(&attempts).await["attempts"][0]["log"], json!(null));
    let path = "/v1/attempts/1/log";
    assert_eq!(server.get(path).await.text(), "");

    server.log(&task, 0, "begins: 1 rad \u{b1} 2\n").await;
    assert_eq!(server.json(&attempts).await["attempts"][0]["log"], path);
    let answer = server.get(path).await;
    assert_eq!(answer.text(), "begins: 1 rad \u{b1} 2\n");
    assert_eq!(answer.header("content-type"), "text/plain; charset=utf-8");
    assert_eq!(answer.header("content-length"), answer.body.len().to_string());
    assert!(answer.header("content-disposition").contains("shard-00000-attempt-1.log"));
    let tag = answer.header("etag").to_owned();
    let same = server.request(Method::GET, path, &[("if-none-match", &tag)]).await;
    assert_eq!(same.status, 304);

    server.log(&task, 100, "ends\n").await;
    let grown = server.request(Method::GET, path, &[("if-none-match", &tag)]).await;
    let expected = "begins: 1 rad \u{b1} 2\n... 81 bytes were left out here ...\nends\n";
    assert_eq!(grown.text(), expected);
    let part = server.request(Method::GET, path, &[("range", "bytes=-5")]).await;
    assert_eq!((part.status.as_u16(), part.text()), (206, "ends\n"));
    let head = server.request(Method::HEAD, path, &[]).await;
    assert_eq!(head.header("content-length"), expected.len().to_string());

    server.get("/v1/attempts/2/log").await.problem(404);
    server.store.release(task.fence).await.unwrap();
    let silent = server.claim().await.unwrap();
    server.store.release(silent.fence).await.unwrap();
    server.get("/v1/attempts/2/log").await.problem(404);
}

#[tokio::test]
async fn the_page_of_a_job_has_the_last_lines_of_what_runs_or_failed() {
    let server = Server::start().await;
    let job = server.submitted(&two_shards()).await["id"].clone();
    let page = format!("/jobs/{job}");
    let task = server.claim().await.unwrap();
    // Its place is there before its first line, which would push what is below it.
    assert!(server.get(&page).await.text().contains("There is no line yet."));
    for k in 0..50 {
        server.log(&task, 10 * k, &format!("line {k:03}<\n")).await;
    }
    let answer = server.get(&page).await;
    let shown = answer.text();
    assert!(shown.contains("line 049&#60;") && !shown.contains("line 009"), "{shown}");
    assert!(
        shown.contains("/v1/attempts/1/log") && shown.contains("log of shard 00000"),
        "{shown}"
    );
    server.store.fail(task.fence, "the arm fell off", store::Retry::Never).await.unwrap();
    let answer = server.get(&page).await;
    assert!(answer.text().contains("line 049&#60;"), "{answer:?}");
}

/// Only the API told the log of a job that succeeded.
#[tokio::test]
async fn the_page_of_a_job_that_succeeded_has_its_last_log_folded() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await["id"].clone();
    let task = server.claim().await.unwrap();
    server.log(&task, 0, "a first try\n").await;
    server.store.release(task.fence).await.unwrap();
    server.work().await;
    let answer = server.get(&format!("/jobs/{job}")).await;
    let shown = answer.text();
    assert!(shown.contains("<details id=\"log\">") && shown.contains("did it"), "{shown}");
    assert!(!shown.contains("a first try"), "{shown}");
}
