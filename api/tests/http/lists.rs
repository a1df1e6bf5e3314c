//! The cost of lists does not grow with the number of items, and tasks come in pages.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::{Value, json};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Metadata, Subscriber};

use crate::fixture::{Server, small_pipeline, small_simulation, small_training};

static COUNT: AtomicUsize = AtomicUsize::new(0);

/// Counts the events of sqlx, one per statement. Each test is a process of its own.
struct Statements;

impl Subscriber for Statements {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.target() == "sqlx::query"
    }

    fn event(&self, _: &Event<'_>) {
        COUNT.fetch_add(1, Ordering::SeqCst);
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}
    fn record_follows_from(&self, _: &Id, _: &Id) {}
    fn enter(&self, _: &Id) {}
    fn exit(&self, _: &Id) {}
}

/// The number of statements of a GET. It is the smallest of several tries, because opening a
/// connection also takes some.
async fn statements(server: &Server, path: &str) -> usize {
    static SUBSCRIBED: OnceLock<()> = OnceLock::new();
    SUBSCRIBED.get_or_init(|| tracing::subscriber::set_global_default(Statements).unwrap());
    let mut fewest = usize::MAX;
    for _ in 0..3 {
        let before = COUNT.load(Ordering::SeqCst);
        let answer = server.get(path).await;
        assert_eq!(answer.status, 200, "{path}: {answer:?}");
        fewest = fewest.min(COUNT.load(Ordering::SeqCst) - before);
    }
    fewest
}

/// Adds another pipeline with a training, an evaluation and a verification.
async fn add_jobs(server: &Server, seed: u64) {
    let mut pipeline = small_pipeline();
    pipeline["name"] = json!(format!("pipeline {seed}"));
    for (_, job) in pipeline["jobs"].as_object_mut().unwrap() {
        job["seed"] = json!(seed);
    }
    let pipeline = server.submitted(&pipeline).await;
    server.work().await;
    let data = server.json(&format!("/v1/jobs/{}", pipeline["members"][0]["job"])).await;
    server.post(&format!("/v1/datasets/{}/verify", data["dataset"])).await;
    server.work().await;
}

/// Regression: a list of 500 jobs took about 2000 statements.
#[tokio::test]
async fn a_list_costs_as_many_statements_for_many_items_as_for_few() {
    let server = Server::start().await;
    let lists = [
        "/v1/jobs",
        "/v1/jobs?kind=train",
        "/v1/datasets",
        "/v1/runs",
        "/v1/checkpoints",
        "/v1/evaluations",
        "/",
        "/jobs/5",
    ];
    add_jobs(&server, 1).await;
    add_jobs(&server, 2).await;
    let mut few = Vec::new();
    for path in lists {
        few.push((path, statements(&server, path).await));
    }
    for seed in 3..8 {
        add_jobs(&server, seed).await;
    }
    assert_eq!(server.json("/v1/jobs").await["jobs"].as_array().unwrap().len(), 42);
    for (path, expected) in few {
        assert!((1..=37).contains(&expected), "{path}: {expected}");
        assert_eq!(statements(&server, path).await, expected, "{path}");
    }
}

/// The labels of a page, and the next page's `after`.
fn read(page: &Value) -> (Vec<String>, Option<i64>) {
    let tasks = page["tasks"].as_array().unwrap();
    let labels = tasks.iter().map(|task| task["label"].as_str().unwrap().to_owned()).collect();
    (labels, page["next"].as_i64())
}

/// Regression: the page of a job with 10 000 tasks, and its list of them, had the result of each.
#[tokio::test]
async fn tasks_are_listed_page_by_page_in_the_order_in_which_they_run() {
    let server = Server::start().await;
    let spec = json!({"preset": "D1-multisine", "trajectories": 620, "shard_trajectories": 1});
    let id = server.submitted(&spec).await["id"].clone();
    let path = format!("/v1/jobs/{id}/tasks");
    let expected: Vec<String> = (0..620).map(|shard| format!("shard {shard:05}")).collect();
    let (first, next) = read(&server.json(&path).await);
    assert_eq!((&first[..], next.is_some()), (&expected[..50], true));
    let (mut seen, mut next) = read(&server.json(&format!("{path}?limit=500")).await);
    while let Some(after) = next {
        let page = server.json(&format!("{path}?limit=100&after={after}")).await;
        let (labels, following) = read(&page);
        seen.extend(labels);
        next = following;
    }
    assert_eq!(seen, expected);

    let page = server.get(&format!("/jobs/{id}")).await;
    assert_eq!(page.text().matches("<td>shard ").count(), 100);
    assert!(page.text().contains("520 more tasks"), "{page:?}");
    let (_, rest) = page.text().split_once("href=\"../v1/jobs/1/tasks?after=").unwrap();
    let after = rest.split('"').next().unwrap();
    let (rest, _) = read(&server.json(&format!("{path}?after={after}")).await);
    assert_eq!(rest, expected[100..150]);
}

#[tokio::test]
async fn a_page_of_tasks_that_cannot_be_is_refused() {
    let server = Server::start().await;
    server.submitted(&small_simulation(1)).await;
    server.submitted(&small_simulation(2)).await;
    for query in ["limit=0", "limit=501", "after=x", "before=1", "after=2", "after=99"] {
        server.get(&format!("/v1/jobs/1/tasks?{query}")).await.problem(400);
    }
    let end = server.json("/v1/jobs/1/tasks?after=1").await;
    assert_eq!(end, json!({"tasks": [], "next": null}));
    server.get("/v1/jobs/9/tasks").await.problem(404);
}

#[tokio::test]
async fn errors_stand_beside_the_name_of_their_data() {
    let server = Server::with_small_pipeline().await;
    for (list, name) in
        [("runs", "train-set"), ("checkpoints", "train-set"), ("evaluations", "test-grid")]
    {
        let page = server.get(&format!("/{list}")).await;
        let cell = format!("<td data-label=\"Data\">{name}</td>");
        assert!(page.text().contains(&cell), "{list}: {page:?}");
    }
    assert_eq!(server.json("/v1/checkpoints/1").await["data"], "train-set");
    assert_eq!(server.json("/v1/evaluations/4").await["data"], "test-grid");
    let mut streamed = small_training(&Value::Null);
    streamed["data"] = json!({"stream": small_simulation(3)});
    let job = server.submitted(&streamed).await;
    let run = server.json(&format!("/v1/runs/{}", job["run"])).await;
    assert_eq!(run["data"], "stream");
}

/// The best of a list was that on the easiest data.
#[tokio::test]
async fn a_list_that_is_sorted_by_errors_on_different_data_leads_to_those_on_one() {
    const CUE: &str = "Errors on different data are not comparable.";
    let server = Server::with_small_pipeline().await;
    let alone = server.get("/checkpoints?sort=rmse").await;
    assert!(!alone.text().contains(CUE), "{alone:?}");
    server.submitted(&small_simulation(3)).await;
    server.work().await;
    server.submitted(&small_training(&json!({"dataset": 3}))).await;
    server.work().await;
    let trained_on = server.json("/v1/datasets?sort=name").await["datasets"].clone();
    let train_set = trained_on.as_array().unwrap().iter().find(|it| it["name"] == "train-set");
    let id = &train_set.unwrap()["id"];
    for list in ["runs", "checkpoints"] {
        assert!(!server.get(&format!("/{list}")).await.text().contains(CUE), "{list}");
        let mixed = server.get(&format!("/{list}?sort=rmse")).await;
        let text = mixed.text();
        let link = format!("/{list}?sort=rmse&#38;dataset={id}\">train-set</a>");
        assert!(text.contains(CUE) && text.contains(&link), "{mixed:?}");
        let one = server.get(&format!("/{list}?sort=rmse&dataset={id}")).await;
        let text = one.text();
        assert!(!text.contains(CUE) && text.contains("On all data"), "{one:?}");
        assert!(text.contains(&format!("name=\"dataset\" value=\"{id}\"")), "{one:?}");
        let listed = server.json(&format!("/v1/{list}?dataset={id}")).await;
        let listed = listed[list].as_array().unwrap();
        assert!(!listed.is_empty() && listed.iter().all(|it| it["data"] == "train-set"), "{list}");
    }
    assert_eq!(server.json("/v1/evaluations?dataset=99").await["evaluations"], json!([]));
    server.get("/v1/runs?dataset=train-set").await.problem(400);
    server.get("/v1/datasets?dataset=1").await.problem(400);
}

#[tokio::test]
async fn filters_and_orders_cost_no_more_statements() {
    let server = Server::start().await;
    add_jobs(&server, 1).await;
    let plain = statements(&server, "/v1/runs").await;
    for query in [
        "sort=name",
        "sort=-finished&kind=train",
        "tag=a&tag=b&text=c",
        "state=failed",
        "dataset=1",
    ] {
        assert!(statements(&server, &format!("/v1/runs?{query}")).await <= plain, "{query}");
    }
}

#[tokio::test]
async fn a_list_is_saved_as_csv_with_its_filter_its_order_and_its_columns() {
    let server = Server::start().await;
    add_jobs(&server, 1).await;
    add_jobs(&server, 2).await;
    let page = server.get("/runs?sort=name&columns=steps").await;
    let link = "/runs?sort=name&#38;columns=steps&#38;format=csv";
    assert!(page.text().contains(link), "{page:?}");

    let asked = "/runs?kind=train&sort=created&columns=steps,train/loss&format=csv&limit=1";
    let csv = server.get(asked).await;
    assert_eq!(csv.header("content-type"), "text/csv; charset=utf-8");
    assert_eq!(csv.header("content-disposition"), "attachment; filename=\"runs.csv\"");
    let lines: Vec<&str> = csv.text().lines().collect();
    let heads =
        "id,name,kind,state,step,last validation RMSE,data,job,created,steps,train/loss,tags";
    assert_eq!((lines[0], lines.len()), (heads, 3), "{lines:?}");
    let listed = server.json("/v1/runs?kind=train&sort=created").await;
    for (line, run) in lines[1..].iter().zip(listed["runs"].as_array().unwrap()) {
        let cells: Vec<&str> = line.split(',').collect();
        let known = [run["id"].to_string(), "train".to_owned(), "succeeded".to_owned()];
        assert_eq!([cells[0], cells[2], cells[3]].map(str::to_owned), known);
        assert_eq!((cells[6], run["data"].as_str()), ("train-set", Some("train-set")), "{line}");
        assert_eq!((cells[8], cells[9]), (run["created_at"].as_str().unwrap(), "100"), "{line}");
    }
    for list in ["datasets", "checkpoints", "evaluations", "robots"] {
        let csv = server.get(&format!("/{list}?format=csv")).await;
        assert!(csv.text().starts_with("id,name,"), "{list}: {csv:?}");
    }
    assert_eq!(server.get("/runs?format=csv&sort=size").await.status, 400);
}

/// A column of a metric had no order, and a name that nothing has an empty column without a word.
#[tokio::test]
async fn chosen_columns_are_suggested_lead_to_their_order_and_are_missed_aloud() {
    let server = Server::with_small_pipeline().await;
    let page = server.get("/runs?columns=train/loss,steps,nosuch").await;
    for part in [
        "<option value=\"train/loss steps nosuch validation/loss\">",
        "<option value=\"train/loss steps nosuch optimizer.learning_rate\">",
        "href=\"./logged?columns=train%2Floss+steps+nosuch&#38;order=metrics.%60train%2Floss%60+ASC\"",
        "<th class=\"number\">steps</th>",
        "Nothing on this page has <code>nosuch</code>.",
    ] {
        assert!(page.text().contains(part), "{part}: {}", page.text());
    }
    let sorted =
        server.get("/logged?columns=train/loss+nosuch&order=metrics.%60train/loss%60+ASC").await;
    for part in ["train/loss \u{2191}", "No run on this page has <code>nosuch</code>."] {
        assert!(sorted.text().contains(part), "{part}: {}", sorted.text());
    }
    for path in ["/runs?columns=train/loss", "/logged?columns=steps", "/checkpoints"] {
        let page = server.get(path).await;
        assert!(!page.text().contains("on this page has"), "{path}: {}", page.text());
        assert!(page.text().contains("<datalist id=\"suggested\"><option"), "{path}");
    }
}
