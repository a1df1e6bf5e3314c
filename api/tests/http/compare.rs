//! The page that shows runs beside each other.

use serde_json::json;

use crate::fixture::{Server, small_training};

/// The page about `query`, which is allowed.
async fn page(server: &Server, query: &str) -> String {
    let answer = server.get(&format!("/compare{query}")).await;
    assert_eq!(answer.status, 200, "{query}: {answer:?}");
    answer.text().to_owned()
}

#[tokio::test]
async fn runs_stand_beside_each_other_with_a_curve_their_metrics_and_what_differs() {
    let server = Server::with_small_pipeline().await;
    let list = server.get("/runs").await;
    for part in
        ["<input type=\"checkbox\" name=\"run\" value=\"1\"", "action=\"./compare\"", ">Compare<"]
    {
        assert!(list.text().contains(part), "{part}: {}", list.text());
    }
    // A training and an evaluation share few fields.
    let both = page(&server, "?run=1&run=2").await;
    for part in
        ["<svg", "Parameters that differ", "train/loss", "batch_size", "bootstrap.resamples"]
    {
        assert!(both.contains(part), "{part}: {both}");
    }
    let chosen = page(&server, "?run=1,2&metric=train/loss&x=time&smoothing=0.5&all=1").await;
    for part in ["<option selected>train/loss", "value=\"0.5\"", "time (s)", "<h2>Parameters</h2>"]
    {
        assert!(chosen.contains(part), "{part}: {chosen}");
    }
    // A run alone, twice or without the metric is no mistake.
    assert!(page(&server, "?run=1&run=1").await.contains("<svg"));
    assert!(page(&server, "?run=2&metric=nothing").await.contains("no data yet"));
    assert!(page(&server, "").await.contains("No runs are chosen"));
}

#[tokio::test]
async fn a_metric_is_drawn_over_a_parameter_that_differs() {
    let server = Server::with_small_pipeline().await;
    server.submitted(&small_training(&json!({"dataset": 1}))).await;
    server.work().await;
    let query = "?run=1,3&metric=train/loss";
    let first = page(&server, query).await;
    assert!(first.contains("<title>train/loss over batch_size</title>"), "{first}");
    let chosen = page(&server, &format!("{query}&against=steps")).await;
    assert!(chosen.contains("<title>train/loss over steps</title>"), "{chosen}");
    assert!(chosen.contains("<option selected>steps"), "{chosen}");
    let other = page(&server, &format!("{query}&against=colour")).await;
    assert!(other.contains("over batch_size"), "another name is no mistake");
    assert!(!page(&server, "?run=1").await.contains(" over batch_size"), "nothing differs");
}

#[tokio::test]
async fn a_comparison_that_is_not_allowed_names_the_parameter() {
    let server = Server::with_small_pipeline().await;
    let many = (1..=21).map(|id| format!("run={id}")).collect::<Vec<_>>().join("&");
    for (query, status, part) in [
        ("?run=one".to_owned(), 400, "ids of runs, whole numbers"),
        ("?run=1&x=epoch".to_owned(), 400, "step or time"),
        ("?run=1&smoothing=1".to_owned(), 400, "0 to 0.99"),
        (format!("?{many}"), 400, "at most 20 runs"),
        ("?run=99".to_owned(), 404, "99"),
    ] {
        let answer = server.get(&format!("/compare{query}")).await;
        assert_eq!(answer.status, status, "{query}");
        assert!(answer.text().contains(part), "{query}: {}", answer.text());
    }
}
