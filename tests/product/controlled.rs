//! Arms under a controller, from data to report.

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, member};

/// A few samples of `panda-real`, with other references for each seed.
fn data(trajectories: u32, seed: u32, excitation: &Value) -> Value {
    json!({
        "preset": "panda-real", "trajectories": trajectories, "samples": 60, "seed": seed,
        "excitation": excitation,
    })
}

#[tokio::test]
async fn models_and_baselines_answer_for_arms_under_a_controller() {
    let grid = json!({
        "fourier": {"frequency_hz": {"grid": [0.2]}},
        "point_to_point": {"frequency_hz": {"grid": [0.5, 1.0]}},
        "via_points": {"frequency_hz": {"grid": [1.0]}},
    });
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let pipeline = json!({
        "kind": "pipeline", "name": "controlled", "jobs": {
            "data": data(40, 1, &json!({})),
            "verify": {"kind": "verify", "data": {"job": "data"}},
            "train": {
                "kind": "train", "data": {"job": "data"}, "context": 40, "batch_size": 8,
                "steps": 4, "optimizer": {"warmup_steps": 0}, "model": {"preset": "lagrangian-tiny"},
            },
            "evaluate": {
                "kind": "evaluate", "data": {"stream": data(8, 9, &grid)}, "context": 40,
                "horizons_s": [0.1, 0.3], "checkpoints": [{"job": "train"}],
                "bootstrap": {"resamples": 100},
            },
        },
    });
    let id = product.submit(&pipeline).await;
    let pipeline = product.succeeded(id).await;

    let simulated = product.get(&format!("/v1/jobs/{}", member(&pipeline, "data"))).await;
    let path = format!("/v1/datasets/{}/files/dataset.json", simulated["dataset"]);
    let columns = product.get(&path).await["columns"].to_string();
    for name in ["r1", "r7", "q_measured7", "reference", "controller"] {
        assert!(columns.contains(&format!("\"{name}\"")), "{name}: {columns}");
    }

    let evaluation = member(&pipeline, "evaluate");
    let report = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    assert_eq!(report["failures"], json!([]));
    let cells: Vec<(&str, f64)> = report["cells"]
        .as_array()
        .unwrap()
        .iter()
        .map(|cell| (cell["family"].as_str().unwrap(), cell["frequency_hz"].as_f64().unwrap()))
        .collect();
    let expected =
        [("fourier", 0.2), ("point-to-point", 0.5), ("point-to-point", 1.0), ("via-points", 1.0)];
    assert_eq!(cells, expected);
}

#[tokio::test]
async fn a_control_job_and_references_without_a_controller_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let control =
        json!({"kind": "control", "data": {"stream": data(2, 1, &json!({}))}, "robots": 2});
    let mut open_loop = data(2, 1, &json!({}));
    open_loop["controller"] = Value::Null;
    for (spec, part) in [(control, "data.controller"), (open_loop, "references need a controller")]
    {
        let (status, answer) = product.post("/v1/jobs", spec.to_string()).await;
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{answer}");
        assert!(answer.to_string().contains(part), "{answer}");
    }
}
