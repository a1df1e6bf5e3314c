//! Measurement noise, from data to report.

use serde_json::{Value, json};

use crate::product::{Product, member};

fn training(data: &Value, preset: &str) -> Value {
    json!({
        "kind": "train", "data": data, "context": 32, "model": {"preset": preset},
        "batch_size": 8, "steps": 10, "validate_every_steps": 10, "validation_trajectories": 8,
    })
}

fn noise() -> Value {
    let observations = json!({"position_noise_rad": 1e-3, "position_resolution_rad": 1e-4, "torque_noise_nm": 0.05});
    let data = json!({"preset": "D1-multisine", "samples": 48, "observations": observations});
    let mut stored = data.clone();
    stored["trajectories"] = json!(40);
    json!({
        "kind": "pipeline", "name": "noise", "jobs": {
            "data": stored,
            "verify": {"kind": "verify", "data": {"job": "data"}},
            "law": training(&json!({"job": "data"}), "lagrangian-tiny"),
            "network": training(&json!({"stream": data}), "cdcnn-tiny"),
            "evaluate": {
                "kind": "evaluate",
                "data": {"stream": {
                    "trajectories": 8, "samples": 48, "seed": 5, "observations": observations,
                    "excitation": {"multisine": {"frequency_hz": {"grid": [0.15, 0.3]}}},
                }},
                "checkpoints": [{"job": "law"}, {"job": "network"}],
                "baselines": ["hold-last", "arx", "identification"],
                "context": 32,
                "position_noise_rad": [0, 1e-2],
                "bootstrap": {"resamples": 100},
            },
        },
    })
}

#[tokio::test]
async fn levels_of_noise_stand_beside_each_other_and_the_noise_of_the_data() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&noise()).await;
    let evaluation = member(&product.succeeded(id).await, "evaluate");
    let report = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    assert_eq!(report["failures"], json!([]));
    let found: Vec<(&str, Option<f64>)> = report["groups"]
        .as_array()
        .unwrap()
        .iter()
        .map(|group| (group["name"].as_str().unwrap(), group["position_noise_rad"].as_f64()))
        .collect();
    let expected = [
        ("in distribution", None),
        ("out of distribution", None),
        ("in distribution at 0.01 rad", Some(0.01)),
        ("out of distribution at 0.01 rad", Some(0.01)),
    ];
    assert_eq!(found, expected);
    let rms = (1e-3_f64.powi(2) + 1e-8 / 12.0).sqrt();
    assert!((report["data_noise"]["position_rad"].as_f64().unwrap() - rms).abs() < 1e-12);
    assert_eq!(report["data_noise"]["torque_nm"], 0.05);
    // The error of held positions is the smoothed noise of the last one, 0.57 degrees at 0.01 rad.
    let cell = |number: usize| report["cells"][number].clone();
    let held = |number: usize| cell(number)["rmse_deg"][0]["mean"].as_f64().unwrap();
    assert_ne!(held(0), held(2));
    assert!((held(0) - held(2)).abs() < 0.6, "{} {}", held(0), held(2));
    assert_eq!(cell(2)["rmse_deg"].as_array().unwrap().len(), 5);
}
