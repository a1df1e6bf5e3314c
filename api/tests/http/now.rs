//! The front page puts running and waiting experiments on top.

use crate::fixture::{Server, small_simulation};

#[tokio::test]
async fn what_runs_stands_above_what_waits_and_both_above_what_has_ended() {
    let server = Server::start().await;
    let ended = server.submitted(&small_simulation(1)).await;
    server.work().await;
    let running = server.submitted(&small_simulation(2)).await;
    assert!(server.claim().await.is_some());
    // More than the front page lists.
    for seed in 3..=25 {
        server.submitted(&small_simulation(seed)).await;
    }
    let page = server.get("/").await;
    let page = page.text();
    assert!(page.contains("1 task runs, 23 tasks wait · "), "{page}");
    let (now, waiting) = page.split_once("<details id=\"waiting\">").expect("experiments wait");
    let named = |job: &serde_json::Value| job["name"].as_str().unwrap().to_owned();
    assert!(now.contains(&named(&running)) && !waiting.contains(&named(&running)), "{page}");
    assert!(waiting.contains("<summary>The newest 20 experiments that wait</summary>"), "{page}");

    // A list of something else is that list alone.
    let succeeded = server.get("/?state=succeeded").await;
    assert!(succeeded.text().contains(&named(&ended)));
    assert!(!succeeded.text().contains("tasks wait"), "{}", succeeded.text());
}

#[tokio::test]
async fn an_old_experiment_that_still_runs_is_shown_and_keeps_the_page_alive() {
    let server = Server::start().await;
    let old = server.submitted(&small_simulation(1)).await;
    assert!(server.claim().await.is_some());
    for seed in 2..=22 {
        server.submitted(&small_simulation(seed)).await;
    }
    server.work().await;
    let page = server.get("/").await;
    let page = page.text();
    assert!(page.contains(old["name"].as_str().unwrap()), "{page}");
    assert!(page.contains("1 task runs, 0 tasks wait"), "{page}");
    assert!(!page.contains("data-settled"), "{page}");
}

#[tokio::test]
async fn an_idle_server_says_nothing_of_tasks() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    server.work().await;
    let page = server.get("/").await;
    assert!(!page.text().contains("class=\"now\""), "{}", page.text());
    assert_eq!(page.text().matches("<article").count(), 1);
}
