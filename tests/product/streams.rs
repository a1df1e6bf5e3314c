//! Trainings and evaluations on robots that are simulated on demand.

use serde_json::{Value, json};

use crate::product::Product;

/// A small training on a stream.
fn training() -> Value {
    json!({
        "kind": "train",
        "data": {"stream": {"preset": "D1-multisine", "samples": 60}},
        "context": 40,
        "model": {
            "architecture": "robomorph", "d_model": 16, "heads": 2,
            "encoder_layers": 1, "decoder_layers": 1, "patch": 5,
        },
        "normalization": "dataset",
        "batch_size": 16,
        "steps": 150,
        "validate_every_steps": 50,
        "checkpoint_every_steps": 20,
    })
}

fn grid() -> Value {
    json!({
        "preset": "grid-multisine",
        "trajectories": 60,
        "samples": 60,
        "excitation": {"multisine": {"frequency_hz": {"grid": [0.05, 0.15, 0.3]}}},
    })
}

/// SHA-256 of the weights after the last step.
async fn weights(product: &Product, training: i64) -> Value {
    let job = product.get(&format!("/v1/jobs/{training}")).await;
    let last = job["checkpoints"].as_array().unwrap().iter().filter_map(Value::as_i64).max();
    let checkpoint = product.get(&format!("/v1/checkpoints/{}", last.unwrap())).await;
    let files = checkpoint["files"].as_array().unwrap().clone();
    let model = files.iter().find(|file| file["name"] == "model.safetensors").unwrap();
    model["sha256"].clone()
}

#[tokio::test]
async fn a_killed_training_on_a_stream_ends_with_the_same_weights() {
    let undisturbed = tempfile::tempdir().unwrap();
    let product = Product::start(undisturbed.path());
    let job = product.submit(&training()).await;
    product.succeeded(job).await;
    let expected = weights(&product, job).await;
    drop(product);

    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let job = product.submit(&training()).await;
    product.job_when(job, |job| !job["checkpoints"].as_array().unwrap().is_empty()).await;
    product.kill_worker().await;
    product.succeeded(job).await;
    assert_eq!(weights(&product, job).await, expected);
}

#[tokio::test]
async fn an_evaluation_on_a_stream_equals_the_one_on_its_dataset() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let trained = product.submit(&training()).await;
    let pipeline = json!({
        "kind": "pipeline",
        "name": "stored",
        "jobs": {
            "grid": grid(),
            "evaluate": {"kind": "evaluate", "data": {"job": "grid"}, "context": 40},
        },
    });
    let stored = product.submit(&pipeline).await;
    product.succeeded(trained).await;
    let stored = product.succeeded(stored).await;
    let stored = crate::product::member(&stored, "evaluate");
    let streamed = json!({"kind": "evaluate", "data": {"stream": grid()}, "context": 40});
    let streamed = product.submit(&streamed).await;
    product.succeeded(streamed).await;
    let mut reports = Vec::new();
    for job in [stored, streamed] {
        let evaluation = product.get(&format!("/v1/evaluations/{job}")).await;
        reports.push(evaluation["report"]["cells"].clone());
    }
    assert_eq!(reports[0], reports[1]);

    // A model that was trained on a stream knows its data.
    let digest = product.get(&format!("/v1/jobs/{trained}")).await["digest"].clone();
    let learned = json!({
        "kind": "evaluate", "data": {"stream": grid()}, "context": 40,
        "checkpoints": [{"digest": digest}],
    });
    let learned = product.submit(&learned).await;
    product.succeeded(learned).await;
    let report = product.get(&format!("/v1/evaluations/{learned}")).await["report"].clone();
    for cell in report["cells"].as_array().unwrap() {
        assert_eq!(cell["in_distribution"], cell["frequency_hz"] == 0.15);
    }
    // A multisine's torques grow with its frequency.
    let outside = report["warnings"].as_array().unwrap().iter();
    let outside: Vec<&Value> =
        outside.filter(|warning| warning["kind"] == "torque-range").collect();
    assert!(!outside.is_empty(), "{report}");
    for warning in outside {
        assert_eq!(warning["predictor"], "robomorph");
        let (reached, most) = (&warning["reached"], &warning["range"][1]);
        assert!(reached.as_f64().unwrap().abs() > most.as_f64().unwrap(), "{warning}");
    }
}

#[tokio::test]
async fn a_stream_and_a_dataset_of_the_same_robots_have_the_same_ranges() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let robots = json!({"preset": "D1-multisine", "samples": 60, "trajectories": 160});
    // Ten batches of 16 use each of them once.
    let train = |data: Value| {
        let mut training = training();
        training["data"] = data;
        training["steps"] = json!(10);
        training["validation_fraction"] = json!(0.0);
        training["optimizer"] = json!({"warmup_steps": 0});
        training
    };
    let stored = json!({
        "kind": "pipeline", "name": "stored",
        "jobs": {"robots": robots, "train": train(json!({"job": "robots"}))},
    });
    let stored = product.submit(&stored).await;
    let stored = crate::product::member(&product.succeeded(stored).await, "train");
    let streamed = product.submit(&train(json!({"stream": robots}))).await;
    product.succeeded(streamed).await;
    let mut ranges = Vec::new();
    for job in [stored, streamed] {
        let job = product.get(&format!("/v1/jobs/{job}")).await;
        let last = job["checkpoints"].as_array().unwrap().iter().filter_map(Value::as_i64).max();
        let path = format!("/v1/checkpoints/{}/files/config.json", last.unwrap());
        let config = product.get(&path).await;
        assert_eq!(config["limits_rad"][1], json!([-1.7628, 1.7628]));
        ranges.push(config["ranges"].clone());
    }
    assert_eq!(ranges[0]["u_nm"].as_array().unwrap().len(), 7);
    assert_eq!(ranges[0], ranges[1]);

    // An evaluation on the same robots says so, whatever their number.
    let digest = product.get(&format!("/v1/jobs/{stored}")).await["digest"].clone();
    let streamed = product.get("/v1/jobs?kind=train").await["jobs"][0]["digest"].clone();
    let few = |seed: u64| json!({"stream": {"preset": "D1-multisine", "samples": 60, "trajectories": 4, "seed": seed}});
    for (data, expected) in
        [(json!({"dataset": 1}), digest), (few(1), streamed.clone()), (few(2), Value::Null)]
    {
        let spec = json!({
            "kind": "evaluate", "data": data, "context": 40, "baselines": ["hold-last"],
            "checkpoints": [{"digest": if expected.is_null() { &streamed } else { &expected }}],
        });
        let job = product.submit(&spec).await;
        product.succeeded(job).await;
        let report = product.get(&format!("/v1/evaluations/{job}")).await["report"].clone();
        let warnings = report["warnings"].as_array().into_iter().flatten();
        let told = warnings.filter(|warning| warning["kind"] == "training-data").count();
        assert_eq!(told, usize::from(!expected.is_null()), "{report}");
    }
}
