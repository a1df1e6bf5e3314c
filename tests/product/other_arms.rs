//! An arm of six joints without code of its own: from its description to closed loops.

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, member, run_to_end, torqued};

fn arm_of_six() -> Value {
    serde_json::from_str(include_str!("../data/arm_of_six.json")).unwrap()
}

fn simulation(trajectories: u32, seed: u32) -> Value {
    json!({
        "kind": "simulate", "trajectories": trajectories, "samples": 60, "seed": seed,
        "robot": {"model": arm_of_six()},
        "excitation": {"multisine": {"frequency_hz": {"fixed": 0.15}}},
    })
}

#[tokio::test]
async fn an_arm_of_six_goes_from_simulation_to_control() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let pipeline = json!({
        "kind": "pipeline", "name": "six joints",
        "jobs": {
            "simulate": simulation(40, 1),
            "train": {
                "kind": "train", "data": {"job": "simulate"}, "context": 40, "batch_size": 8,
                "steps": 4, "optimizer": {"warmup_steps": 0}, "model": {"preset": "robomorph-tiny"},
            },
            "evaluate": {
                "kind": "evaluate", "data": {"stream": simulation(10, 9)}, "context": 40,
                "checkpoints": [{"job": "train"}], "bootstrap": {"resamples": 200},
            },
            "control": {
                "kind": "control", "data": {"stream": simulation(2, 7)}, "robots": 2,
                "checkpoints": [{"job": "train"}],
                "context": 40, "duration_s": 0.5, "bootstrap": {"resamples": 200},
                "planner": {"samples": 16, "horizon": 12, "knot_every": 6},
            },
        },
    });
    let id = product.submit(&pipeline).await;
    let pipeline = product.succeeded(id).await;

    let simulated = product.get(&format!("/v1/jobs/{}", member(&pipeline, "simulate"))).await;
    let path = format!("/v1/datasets/{}/files/dataset.json", simulated["dataset"]);
    let columns = product.get(&path).await["columns"]["trajectories"].to_string();
    assert!(columns.contains("\"u6\"") && !columns.contains("\"u7\""), "{columns}");

    let trained = product.get(&format!("/v1/jobs/{}", member(&pipeline, "train"))).await;
    let path = format!("/v1/checkpoints/{}/predict", trained["checkpoints"][0]);
    let rows = |count: usize, joints: usize| vec![vec![0.1; joints]; count];
    let question = |joints: usize| {
        let scenario = json!({
            "u": rows(40, joints), "y": rows(40, joints), "future_u": rows(20, joints),
        });
        json!({"scenarios": [scenario]}).to_string()
    };
    let (status, answer) = product.post(&path, question(6)).await;
    assert_eq!(status, StatusCode::OK, "{answer}");
    let predicted = answer["scenarios"][0]["y"].as_array().unwrap();
    assert_eq!((predicted.len(), predicted[0].as_array().unwrap().len()), (20, 6));
    let (status, problem) = product.post(&path, question(7)).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{problem}");

    for (name, list, field) in
        [("evaluate", "predictors", "joint_rmse_deg"), ("control", "controllers", "joint_rms_deg")]
    {
        let job = product.get(&format!("/v1/jobs/{}", member(&pipeline, name))).await;
        let path = format!("/v1/runs/{}/artifacts/report.json", job["run"]);
        let report = product.get(&path).await;
        let text = report.to_string();
        assert!(text.contains(list) && text.contains("robomorph"), "{report:#}");
        let joints = lists(&report, field);
        assert!(!joints.is_empty() && joints.iter().all(|count| *count == 6), "{report:#}");
        let page = product.get(&format!("/jobs/{}", job["id"])).await;
        assert!(page.as_str().unwrap().contains("oracle") == (name == "control"));
    }
}

/// The recording is a simulation, sent as an upload.
#[tokio::test]
async fn a_recording_of_an_arm_of_six_is_trained_on_evaluated_and_verified() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let [spec, folder] = ["simulate.json", "six"].map(|name| data.path().join(name));
    std::fs::write(&spec, simulation(24, 1).to_string()).unwrap();
    let [spec, out] = [&spec, &folder].map(|path| path.to_str().unwrap());
    let simulated = run_to_end(&mut torqued(&["simulate", "--spec", spec, "--out", out]));
    assert_eq!(simulated.0, Some(0), "{}", simulated.2);
    let file = folder.join("trajectories-00000.parquet");

    let columns = |prefix: &str, joints: usize| -> Vec<String> {
        (1..=joints).map(|joint| format!("{prefix}{joint}")).collect()
    };
    let import = |joints: usize| {
        let mapping = json!({
            "columns": {
                "recording": "trajectory", "u": columns("u", joints), "q": columns("q", joints),
            },
            "robot": {"model": arm_of_six()}, "samples": 60,
        });
        let spec = data.path().join("mapping.json");
        std::fs::write(&spec, mapping.to_string()).unwrap();
        let [file, spec] = [&file, &spec].map(|path| path.to_str().unwrap());
        let arguments = ["import", file, "--spec", spec, "--wait", "--server", &product.url];
        run_to_end(&mut torqued(&arguments))
    };
    let (code, _, errors) = import(7);
    assert_eq!(code, Some(1), "{errors}");
    assert!(errors.contains("columns.u is 7 columns, allowed: 6 columns"), "{errors}");
    let (code, output, errors) = import(6);
    assert_eq!(code, Some(0), "{output}{errors}");

    let imported = product.get("/v1/datasets/1").await;
    assert_eq!(imported["trajectories"], 24, "{imported:#}");
    let described = product.get("/v1/datasets/1/files/dataset.json").await;
    let model = &described["spec"]["robot"]["model"];
    assert_eq!(model["name"], arm_of_six()["name"]);
    assert_eq!(model["joints"].as_array().unwrap().len(), 6);
    let described = described["columns"]["trajectories"].to_string();
    assert!(described.contains("\"u6\"") && !described.contains("\"u7\""), "{described}");
    let page = product.get("/datasets/1").await;
    assert!(page.as_str().unwrap().contains("u6"), "{page}");

    let verified = product.post("/v1/datasets/1/verify", "").await.1;
    product.succeeded(verified["id"].as_i64().unwrap()).await;
    let pipeline = json!({
        "kind": "pipeline", "name": "six recorded joints",
        "jobs": {
            "train": {
                "kind": "train", "data": {"dataset": 1}, "context": 40, "batch_size": 8, "steps": 4,
                "optimizer": {"warmup_steps": 0}, "model": {"preset": "robomorph-tiny"},
            },
            "evaluate": {
                "kind": "evaluate", "data": {"dataset": 1}, "context": 40,
                "checkpoints": [{"job": "train"}], "bootstrap": {"resamples": 200},
            },
        },
    });
    let pipeline = product.submit(&pipeline).await;
    let pipeline = product.succeeded(pipeline).await;
    let job = product.get(&format!("/v1/jobs/{}", member(&pipeline, "evaluate"))).await;
    let report = product.get(&format!("/v1/runs/{}/artifacts/report.json", job["run"])).await;
    let joints = lists(&report, "joint_rmse_deg");
    assert!(!joints.is_empty() && joints.iter().all(|count| *count == 6), "{report:#}");
    let text = report.to_string();
    assert!(text.contains("robomorph") && text.contains("identification"), "{report:#}");
}

/// Lengths of all lists called `field`, wherever they are.
fn lists(value: &Value, field: &str) -> Vec<usize> {
    let mut found = Vec::new();
    if let Some(list) = value.get(field).and_then(Value::as_array) {
        found.push(list.len());
    }
    let inner: Vec<&Value> = match value {
        Value::Object(fields) => fields.values().collect(),
        Value::Array(items) => items.iter().collect(),
        _ => Vec::new(),
    };
    found.extend(inner.into_iter().flat_map(|inner| lists(inner, field)));
    found
}
