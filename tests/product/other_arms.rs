//! An arm of six joints that no code knows: from its description to closed loops.

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, member};

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
                "path": {"point-to-point": {"displacement_rad": vec![0.2; 6], "duration_s": 0.4}},
                "planner": {
                    "samples": 16, "horizon": 12, "knot_every": 6,
                    "noise_nm": [3, 3, 2, 1, 1, 1],
                },
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
