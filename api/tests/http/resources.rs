//! Reading jobs, datasets, runs, checkpoints and evaluations.

use serde_json::json;
use spec::Resources;
use store::WorkerProcess;

use crate::fixture::{Server, report, small_pipeline, small_simulation};

#[tokio::test]
async fn the_server_tells_its_health_and_version() {
    let server = Server::start().await;
    let health = server.json("/healthz").await;
    assert_eq!((&health["status"], &health["workers"]), (&json!("degraded"), &json!(0)));
    assert_eq!(health["version"], env!("CARGO_PKG_VERSION"));
    assert!(health["database_schema"].as_i64().unwrap() >= 2);
    assert!(health["free_bytes"].as_u64().unwrap() > 0);

    server.store.register_worker(&worker()).await.unwrap();
    let health = server.json("/healthz").await;
    assert_eq!((&health["status"], &health["workers"]), (&json!("ok"), &json!(1)));
    assert_eq!(health["reasons"], json!(null));
}

#[tokio::test]
async fn workers_are_listed_and_shown_on_the_page() {
    let server = Server::start().await;
    assert_eq!(server.json("/v1/workers").await, json!({"workers": []}));
    assert!(server.get("/workers").await.text().contains("<h2>No workers</h2>"));
    server.store.register_worker(&worker()).await.unwrap();
    let listed = &server.json("/v1/workers").await["workers"][0];
    assert_eq!((&listed["name"], &listed["pid"]), (&json!("w1"), &json!(7)));
    assert_eq!((&listed["alive"], &listed["task"]), (&json!(true), &json!(null)));
    let answer = server.get("/workers").await;
    let page = answer.text();
    assert!(page.contains("lab-3") && page.contains("waits for a task"), "{page}");
}

pub fn worker() -> WorkerProcess {
    WorkerProcess {
        name: "w1".to_owned(),
        host: "lab-3".to_owned(),
        pid: 7,
        version: "1.2.3".to_owned(),
        device: "cpu".to_owned(),
        threads: 2,
        offers: Resources { gpus: 1, ..Resources::default() },
    }
}

#[tokio::test]
async fn every_preset_that_is_listed_can_be_submitted() {
    let server = Server::start().await;
    let presets = server.json("/v1/presets").await;
    for preset in presets["presets"].as_array().unwrap() {
        if preset["place"] == "job" {
            server.submitted(&json!({"preset": preset["name"]})).await;
        }
    }
}

#[tokio::test]
async fn jobs_are_listed_newest_first_page_by_page() {
    let server = Server::start().await;
    for seed in 1..=5 {
        server.submitted(&small_simulation(seed)).await;
    }
    let mut seen = Vec::new();
    let mut path = "/v1/jobs?limit=2".to_owned();
    loop {
        let page = server.json(&path).await;
        seen.extend(page["jobs"].as_array().unwrap().iter().map(|job| job["id"].as_i64().unwrap()));
        match page["next"].as_str() {
            Some(next) => path = format!("/v1/jobs?limit=2&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(seen, [5, 4, 3, 2, 1]);
    let older = server.json("/v1/jobs?before=3").await;
    assert_eq!(older["jobs"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn jobs_are_filtered_by_state_and_kind() {
    let server = Server::with_small_pipeline().await;
    server.submitted(&small_simulation(9)).await;
    let count = async |query: &str| {
        server.json(&format!("/v1/jobs?{query}")).await["jobs"].as_array().unwrap().len()
    };
    assert_eq!(count("").await, 6);
    assert_eq!(count("state=queued").await, 1);
    assert_eq!(count("state=succeeded&kind=simulate").await, 2);
    assert_eq!(count("kind=pipeline").await, 1);
}

#[tokio::test]
async fn a_cancelled_job_says_so_and_stays_so() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    let path = format!("/v1/jobs/{}/cancel", job["id"]);
    for _ in 0..2 {
        let answer = server.post(&path).await;
        assert_eq!((answer.status.as_u16(), &answer.json()["state"]), (200, &json!("cancelled")));
    }
}

#[tokio::test]
async fn a_running_task_tells_its_worker_and_progress() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    let task = server.claim().await.unwrap();
    let progress =
        store::Progress { done: 4, rate_per_second: Some(2.0), message: Some("hot".to_owned()) };
    server.store.renew(task.fence, std::time::Duration::from_secs(60), &progress).await.unwrap();
    let tasks = server.json(&format!("/v1/jobs/{}/tasks", job["id"])).await;
    let task = &tasks["tasks"][0];
    assert_eq!((&task["state"], &task["worker"]), (&json!("running"), &json!("test-worker")));
    assert_eq!((&task["attempt"], &task["epoch"]), (&json!(1), &json!(1)));
    let expected = json!({"done": 4, "total": 10, "unit": "trajectories",
                          "rate_per_second": 2.0, "message": "hot"});
    assert_eq!(task["progress"], expected);
    assert_eq!(server.json(&format!("/v1/jobs/{}", job["id"])).await["progress"], expected);
}

#[tokio::test]
async fn a_failed_job_says_why() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    server.fail_next("the arm fell off").await;
    let job = server.json(&format!("/v1/jobs/{}", job["id"])).await;
    assert_eq!(job["state"], "failed");
    assert!(job["error"].as_str().unwrap().contains("the arm fell off"));
}

#[tokio::test]
async fn a_dataset_lists_its_files_with_their_rows() {
    let server = Server::with_small_pipeline().await;
    let list = server.json("/v1/datasets").await;
    assert_eq!(list["datasets"].as_array().unwrap().len(), 2);
    let train_set =
        list["datasets"].as_array().unwrap().iter().find(|item| item["name"] == "train-set");
    let dataset = server.json(&format!("/v1/datasets/{}", train_set.unwrap()["id"])).await;
    assert_eq!(dataset["state"], "complete");
    assert_eq!((&dataset["trajectories"], &dataset["samples"]), (&json!(200), &json!(400)));
    let files = dataset["files"].as_array().unwrap();
    assert_eq!((&files[0]["name"], &files[0]["rows"]), (&json!("dataset.json"), &json!(null)));
    let files = &files[1..];
    let bytes: u64 = files.iter().map(|file| file["size"].as_u64().unwrap()).sum();
    assert_eq!((&dataset["rejected"], &dataset["bytes"]), (&json!(6), &json!(bytes)));
    let rows: Vec<_> = files
        .iter()
        .map(|file| (file["name"].as_str().unwrap(), file["rows"].as_u64().unwrap()))
        .collect();
    let expected = [
        ("trajectories-00000.parquet", 40_000),
        ("robots-00000.parquet", 100),
        ("trajectories-00001.parquet", 40_000),
        ("robots-00001.parquet", 100),
    ];
    assert_eq!(rows, expected);
}

#[tokio::test]
async fn a_run_has_its_latest_metrics_and_their_curves() {
    let server = Server::with_small_pipeline().await;
    let train = server.json("/v1/jobs?kind=train").await["jobs"][0].clone();
    let run = server.json(&format!("/v1/runs/{}", train["run"])).await;
    assert_eq!((&run["kind"], &run["job"]), (&json!("train"), &train["id"]));
    assert_eq!(run["metrics"]["train/loss"]["step"], 99);
    for key in ["train/loss", "train%2Floss"] {
        let metric = server.json(&format!("/v1/runs/{}/metrics/{key}", run["id"])).await;
        assert_eq!((&metric["key"], &metric["recorded"]), (&json!("train/loss"), &json!(100)));
        assert_eq!(metric["points"].as_array().unwrap().len(), 100);
    }
    let thin = server.json(&format!("/v1/runs/{}/metrics/train/loss?points=10", run["id"])).await;
    assert!(thin["points"].as_array().unwrap().len() <= 10);
    for points in ["1", "5001", "x"] {
        let path = format!("/v1/runs/{}/metrics/train/loss?points={points}", run["id"]);
        server.get(&path).await.problem(400);
    }
    assert_eq!(server.json("/v1/runs").await["runs"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn a_loss_that_is_not_a_number_is_null() {
    let server = Server::start().await;
    let data = server.submitted(&small_simulation(1)).await;
    server.work().await;
    let spec = crate::fixture::small_training(&json!({"dataset": data["dataset"]}));
    let train = server.submitted(&spec).await;
    let task = server.claim().await.unwrap();
    let metric = store::Metric { key: "train/loss".to_owned(), step: 0, value: f64::NAN };
    server.store.record_metrics(task.fence, &[metric]).await.unwrap();
    let run = server.json(&format!("/v1/runs/{}", train["run"])).await;
    assert_eq!(run["metrics"]["train/loss"], json!({"step": 0, "value": null}));
    let path = format!("/v1/runs/{}/figures/loss.svg", train["run"]);
    assert_eq!(server.get(&path).await.status, 200);
}

#[tokio::test]
async fn a_checkpoint_lists_its_files() {
    let server = Server::with_small_pipeline().await;
    let list = server.json("/v1/checkpoints").await;
    let checkpoint = server.json("/v1/checkpoints/1").await;
    assert_eq!(list["checkpoints"], json!([checkpoint]));
    assert_eq!((&checkpoint["step"], &checkpoint["final"]), (&json!(100), &json!(true)));
    assert_eq!(checkpoint["architecture"], "robomorph");
    assert_eq!(checkpoint["files"][1]["name"], "model.safetensors");
    let job = server.json(&format!("/v1/jobs/{}", checkpoint["job"])).await;
    assert_eq!(job["checkpoints"], json!([1]));
}

#[tokio::test]
async fn an_evaluation_has_cells_first_and_a_report_in_the_end() {
    let server = Server::start().await;
    let pipeline = server.submitted(&small_pipeline()).await;
    let id = pipeline["members"][3]["job"].as_i64().unwrap();
    let before = server.json(&format!("/v1/evaluations/{id}")).await;
    assert_eq!(before["report"], json!(null));
    assert_eq!(before["cells"][0]["label"], "multisine 0.15 Hz");
    assert_eq!(before["cells"][1]["state"], "waiting");
    server.work().await;
    let after = server.json(&format!("/v1/evaluations/{id}")).await;
    assert_eq!(after["report"], report());
    assert_eq!(after["artifacts"].as_array().unwrap().len(), 3);
    let list = server.json("/v1/evaluations").await;
    assert_eq!(list["evaluations"][0]["id"], id);
}
