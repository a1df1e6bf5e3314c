//! Evaluations over samplers and frequencies: named, paired, repeatable, and repeated where a cell
//! is missing.

use serde_json::{Value, json};

use crate::product::{PATIENCE, Product, member, run_to_end, torqued};

/// A denoiser of ten levels that learns almost nothing.
fn training(seed: u64) -> Value {
    json!({
        "kind": "train",
        "data": {"stream": {"preset": "D1-multisine", "samples": 48}},
        "context": 32,
        "model": {"preset": "cdcnn-tiny", "widths": [16, 32], "diffusion": {"steps": 10}},
        "batch_size": 8,
        "steps": 10,
        "seed": seed,
        "validate_every_steps": 10,
        "validation_trajectories": 8,
        "sampled_trajectories": 8,
    })
}

fn sweep() -> Value {
    json!({
        "kind": "pipeline", "name": "sweep", "jobs": {
            "first": training(1),
            "second": training(2),
            "evaluate": {
                "kind": "evaluate",
                "data": {"stream": {
                    "trajectories": 12, "samples": 51, "seed": 5,
                    "excitation": {
                        "chirp": {"frequency_hz": {"grid": [0.3]}},
                        "multisine": {"frequency_hz": {"grid": [0.15, 0.3]}},
                    },
                }},
                "checkpoints": [{"job": "first"}, {"job": "second"}],
                "baselines": ["hold-last", "arx"],
                "context": 32,
                "rounds": 3,
                "samplers": [
                    {"kind": "ddim", "steps": [1, 5]},
                    {"kind": "ddpm", "steps": [2, 5], "start": "shifted"},
                    {"steps": 2, "start": "oracle"},
                ],
                "samples": 4,
                "seed": 3,
                "latency": {"repeats": 20},
                "bootstrap": {"resamples": 100},
                "execution": {"max_attempts": 20},
            },
        },
    })
}

async fn report(product: &Product, evaluation: i64) -> Value {
    let mut report = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    for predictor in report["predictors"].as_array_mut().unwrap() {
        predictor.as_object_mut().unwrap().remove("latency");
    }
    report
}

/// Digests of all artifacts without latencies, by name.
async fn artifacts(product: &Product, evaluation: i64) -> Vec<(String, String)> {
    let evaluation = product.get(&format!("/v1/evaluations/{evaluation}")).await;
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let all = evaluation["artifacts"].as_array().unwrap().iter();
    all.map(|file| (text(&file["name"]), text(&file["sha256"])))
        .filter(|(name, _)| !name.starts_with("latency") && name != "report.json")
        .collect()
}

async fn files(product: &Product, evaluation: i64) -> Vec<String> {
    artifacts(product, evaluation).await.into_iter().map(|(name, _)| name).collect()
}

fn names(list: &Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|item| item["name"].as_str().unwrap()).collect()
}

#[tokio::test]
async fn a_sweep_that_is_killed_again_and_again_ends_with_the_same_bytes() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&sweep()).await;
    let evaluation = member(&product.succeeded(id).await, "evaluate");
    let expected = (report(&product, evaluation).await, artifacts(&product, evaluation).await);
    let full = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    drop(product);

    let learned = |job: &str| {
        ["ddim 1 cold", "ddim 5 cold", "ddpm 2 shifted", "ddpm 5 shifted", "ddim 2 oracle"]
            .map(|run| format!("{job} {run}"))
    };
    let mut predictors = vec!["hold-last".to_owned(), "arx".to_owned()];
    predictors.extend(learned("first").into_iter().chain(learned("second")));
    assert_eq!(names(&full["predictors"]), predictors);
    assert_eq!(names(&full["groups"]), ["in distribution", "out of distribution"]);
    let cells = full["cells"].as_array().unwrap();
    let families: Vec<&Value> = cells.iter().map(|cell| &cell["family"]).collect();
    assert_eq!(families, ["chirp", "multisine", "multisine"]);
    for cell in cells {
        assert_eq!(cell["scenarios"], 4);
        assert_eq!(cell["rmse_deg"].as_array().unwrap().len(), predictors.len(), "{cell:#}");
        let scores = cell["scores"].as_array().unwrap();
        let with_samples = scores.iter().filter(|scores| scores["crps_deg"].is_object());
        assert_eq!(with_samples.count(), 10);
    }
    let latencies: Vec<&Value> = full["predictors"].as_array().unwrap().iter().collect();
    for predictor in &latencies[2..] {
        let latency = &predictor["latency"];
        let of = |key: &str| latency[key].as_f64().unwrap();
        assert!(of("median_ms") > 0.0 && of("median_ms") <= of("p99_ms"), "{predictor:#}");
        assert_eq!((&latency["threads"], &latency["device"]), (&json!(1), &json!("cpu")));
    }
    let files: Vec<&str> = expected.1.iter().map(|(name, _)| name.as_str()).collect();
    for name in ["cell-002.parquet", "scenarios.parquet", "rmse-chirp.svg", "crps-multisine.csv"] {
        assert!(files.contains(&name), "{name} is not among {files:?}");
    }
    assert!(files.contains(&"steps-out-of-distribution.svg"), "{files:?}");

    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&sweep()).await;
    let pipeline = product.job_when(id, |job| job["members"].as_array().unwrap().len() == 3).await;
    let evaluation = member(&pipeline, "evaluate");
    for cells in 1..=3 {
        let path = format!("/v1/evaluations/{evaluation}");
        let begun = async {
            loop {
                let tasks = product.get(&format!("/v1/jobs/{evaluation}/tasks")).await;
                let states =
                    tasks["tasks"].as_array().unwrap().iter().map(|task| task["state"].clone());
                if states.filter(|state| state == "succeeded" || state == "running").count()
                    >= cells
                {
                    return;
                }
                tokio::time::sleep(std::time::Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(PATIENCE, begun)
            .await
            .unwrap_or_else(|_| panic!("{path} never began"));
        product.kill_worker().await;
    }
    product.succeeded(id).await;
    let found = (report(&product, evaluation).await, artifacts(&product, evaluation).await);
    assert_eq!(found, expected);
}

#[tokio::test]
async fn a_cell_that_failed_is_named_and_a_retry_evaluates_nothing_but_what_is_missing() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = sweep();
    let evaluate = &mut spec["jobs"]["evaluate"];
    // The first kill ends the cell.
    evaluate["execution"]["max_attempts"] = 1.into();
    evaluate["latency"] = Value::Null;
    // Cells are so long that the kill hits the second one.
    evaluate["samples"] = 200.into();
    let pipeline = product.submit(&spec).await;
    let members = product.get(&format!("/v1/jobs/{pipeline}")).await;
    let failed = member(&members, "evaluate");
    let second = |tasks: &Value| tasks["tasks"][1]["state"] == "running";
    let begun = async {
        while !second(&product.get(&format!("/v1/jobs/{failed}/tasks")).await) {
            tokio::time::sleep(std::time::Duration::from_millis(5)).await;
        }
    };
    tokio::time::timeout(PATIENCE, begun).await.expect("the second cell begins");
    product.kill_worker().await;
    assert_eq!(product.finished(pipeline).await["state"], "failed");
    let evaluation = product.get(&format!("/v1/evaluations/{failed}")).await;
    assert_eq!(evaluation["state"], "failed");
    let cells = evaluation["cells"].as_array().unwrap();
    assert_eq!((&cells[0]["state"], &cells[1]["state"]), (&json!("succeeded"), &json!("failed")));
    assert!(cells[1]["error"].as_str().unwrap().contains("attempt 1 of 1"), "{:#}", cells[1]);
    let made = names(&evaluation["artifacts"]);
    assert!(made.contains(&"cell-000.parquet") && !made.contains(&"cell-001.parquet"), "{made:?}");

    let refused = product.post("/v1/jobs/1/retry", "").await;
    assert_eq!(refused.0, reqwest::StatusCode::CONFLICT, "{}", refused.1);
    let id = pipeline.to_string();
    let retry = ["retry", &id, "--watch", "--server", &product.url];
    let (code, output, errors) = run_to_end(&mut torqued(&retry));
    assert_eq!(code, Some(0), "{output}{errors}");
    let jobs = product.get("/v1/jobs").await;
    let again = jobs["jobs"].as_array().unwrap().iter().find(|job| job["kind"] == "pipeline");
    let again = member(again.unwrap(), "evaluate");
    assert_ne!(again, failed);
    let tasks = product.get(&format!("/v1/jobs/{again}/tasks")).await["tasks"].clone();
    let attempts: Vec<&Value> =
        tasks.as_array().unwrap().iter().map(|task| &task["attempt"]).collect();
    // The next worker may have evaluated the third one before the death was noticed.
    let third = u32::from(files(&product, again).await.contains(&"cell-002.parquet".to_owned()));
    assert_eq!(json!(attempts), json!([0, 1, third, 1]));
    let files = files(&product, again).await;
    let has = |name: &str| files.iter().any(|file| file == name);
    assert!(!has("cell-000.parquet") && has("cell-001.parquet"), "{files:?}");

    // The result equals that of one evaluation without interruption.
    let mut whole = product.get(&format!("/v1/jobs/{again}")).await["spec"].clone();
    whole["execution"] = json!({});
    let (_, whole) = product.post("/v1/jobs?force=true", whole.to_string()).await;
    let whole = whole["id"].as_i64().unwrap();
    product.succeeded(whole).await;
    assert_eq!(report(&product, again).await, report(&product, whole).await);
}

#[tokio::test]
async fn an_evaluation_that_names_no_data_has_both_families_and_every_frequency() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let spec = json!({
        "kind": "evaluate", "context": 40, "horizon": 20, "scenarios": 2,
        "baselines": ["hold-last", "damped-integrator"], "bootstrap": {"resamples": 100},
    });
    let id = product.submit(&spec).await;
    let job = product.succeeded(id).await;
    let stream = &job["spec"]["data"]["stream"];
    assert_eq!((&stream["trajectories"], &stream["samples"]), (&json!(42), &json!(60)));
    let report = report(&product, id).await;
    let cells = report["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 21);
    assert_eq!(cells[10]["frequency_hz"], 0.01);
    assert!(cells.iter().all(|cell| cell["scenarios"] == 2 && cell["in_distribution"] == false));
}
