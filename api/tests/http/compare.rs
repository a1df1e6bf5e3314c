//! The page that shows runs beside each other.

use axum::http::Method;
use serde_json::json;

use crate::fixture::{Server, small_training};
use crate::mlflow::posted;

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
    let run = server.json("/v1/runs/1").await;
    let digest = run["spec"]["data"]["digest"].as_str().unwrap();
    let named = format!("<td>train-set ({})</td>", &digest[..12]);
    assert!(both.contains(&named), "{named}: {both}");
    let csv = server.get("/compare?run=1&run=2&format=csv").await;
    assert_eq!(csv.header("content-type"), "text/csv; charset=utf-8");
    for part in ["metric,1 train,2 evaluate\n", "\nparameter,1 train,2 evaluate\n", digest] {
        assert!(csv.text().contains(part), "{part}: {}", csv.text());
    }
    assert!(both.contains("href=\"./compare?run=1&#38;run=2&#38;format=csv\""), "{both}");
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
async fn a_run_that_a_client_logged_stands_beside_a_run_of_torqued() {
    let server = Server::with_small_pipeline().await;
    let named = json!({"experiment_id": "0", "start_time": 1, "run_name": "mine"});
    let run = posted(&server, "runs/create", named).await;
    let id = run["run"]["info"]["run_id"].as_str().unwrap().to_owned();
    let metric = |step: u64, value: f64| json!({"key": "train/loss", "value": value, "timestamp": step, "step": step});
    let metrics = [metric(1, 3.0), metric(2, 2.0)];
    let params = [json!({"key": "batch_size", "value": "16"})];
    let fields = json!({"run_id": id, "metrics": metrics, "params": params});
    posted(&server, "runs/log-batch", fields).await;
    assert!(server.get("/logged").await.text().contains(&format!("name=\"run\" value=\"{id}\"")));
    let both = page(&server, &format!("?run=1+{id}&metric=train/loss")).await;
    let name = format!("{} mine", &id[..8]);
    for part in [name.as_str(), "<title>train/loss over batch_size</title>", "<svg"] {
        assert!(both.contains(part), "{part}: {both}");
    }
    assert!(both.contains(&format!("href=\"./logged/{id}\"")), "{both}");
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
async fn curves_are_grouped_by_the_value_of_a_parameter() {
    let server = Server::with_small_pipeline().await;
    for (seed, steps) in [(1, 20), (2, 20), (3, 30)] {
        let mut training = small_training(&json!({"dataset": 1}));
        (training["seed"], training["steps"]) = (json!(seed), json!(steps));
        server.submitted(&training).await;
        server.work().await;
    }
    let query = "?run=3,4,5&metric=train/loss";
    let by_seeds = page(&server, query).await;
    assert!(by_seeds.contains("mean of 2 seeds"), "{by_seeds}");
    assert!(!by_seeds.contains("<option>seed</option>"), "seeds are no parameter");
    let by_steps = page(&server, &format!("{query}&group=steps")).await;
    for part in ["steps 20, mean of 2 runs", ">steps 30<", "<option selected>steps"] {
        assert!(by_steps.contains(part), "{part}: {by_steps}");
    }
    let other = page(&server, &format!("{query}&group=colour")).await;
    assert!(other.contains("mean of 2 seeds"), "another name is no mistake");
}

/// The page said "mean of 4 seeds" of runs with the seeds 0, 0, 1 and 2.
#[tokio::test]
async fn runs_and_their_seeds_are_counted_apart() {
    let server = Server::with_small_pipeline().await;
    for seed in [0, 0, 1, 2, 3, 4, 5] {
        let mut training = small_training(&json!({"dataset": 1}));
        training["seed"] = json!(seed);
        let answer = server.submit_to("/v1/jobs?force=true", &training, &[]).await;
        assert_eq!(answer.status, 201, "{answer:?}");
        server.work().await;
    }
    let four = page(&server, "?run=3,4,5,6&metric=train/loss").await;
    assert!(four.contains("mean of 4 runs, 3 seeds"), "{four}");
    assert!(!four.contains("<th>Run</th>"), "{four}");
    // Above six runs, each has a row.
    let seven = page(&server, "?run=3,4,5,6,7,8,9&metric=train/loss").await;
    assert!(seven.contains("3 … train") && seven.contains("mean of 7 runs, 6 seeds"), "{seven}");
    assert!(seven.contains("<th>run</th><th>seed</th>"), "{seven}");
}

#[tokio::test]
async fn a_comparison_renews_itself_while_a_run_runs() {
    let server = Server::with_small_pipeline().await;
    let settled = "id=\"shown\" data-live data-events=\"./v1/events\" data-settled=\"for-good\"";
    assert!(page(&server, "?run=1,2").await.contains(settled));
    server.submitted(&small_training(&json!({"dataset": 1}))).await;
    server.claim().await.unwrap();
    let running = page(&server, "?run=1,3").await;
    assert!(running.contains("data-live") && !running.contains("data-settled"), "{running}");
}

#[tokio::test]
async fn a_comparison_that_is_not_allowed_names_the_parameter() {
    let server = Server::with_small_pipeline().await;
    let many = (1..=33).map(|id| format!("run={id}")).collect::<Vec<_>>().join("&");
    for (query, status, part) in [
        ("?run=one".to_owned(), 400, "ids of runs, and identifiers of logged ones"),
        ("?run=1&x=epoch".to_owned(), 400, "step or time"),
        ("?run=1&smoothing=1".to_owned(), 400, "0 to 0.99"),
        (format!("?{many}"), 400, "at most 32 runs"),
        ("?run=99".to_owned(), 404, "99"),
        (format!("?run={}", "0".repeat(32)), 404, "00000000"),
    ] {
        let answer = server.get(&format!("/compare{query}")).await;
        assert_eq!(answer.status, status, "{query}");
        assert!(answer.text().contains(part), "{query}: {}", answer.text());
    }
}

#[tokio::test]
async fn a_run_in_the_trash_is_left_out_and_said() {
    let server = Server::with_small_pipeline().await;
    let deleted = server.request(Method::DELETE, "/v1/runs/2?force=true", &[]).await;
    assert_eq!(deleted.status, 200);
    let others = page(&server, "?run=1,2").await;
    for part in ["Run 2 is in the trash", "action=\"./runs/2/restore\"", "<svg"] {
        assert!(others.contains(part), "{part}: {others}");
    }
    assert!(!others.contains("value=\"2\""), "{others}");
    server.post("/runs/2/restore").await;
    assert!(!page(&server, "?run=1,2").await.contains("in the trash"));
}
