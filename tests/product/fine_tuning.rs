//! Trainings that begin with the weights of another one, on several sources of data.

use std::time::{Duration, Instant};

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, member};

fn data(seed: u32) -> Value {
    json!({"preset": "D1-multisine", "trajectories": 40, "samples": 48, "seed": seed})
}

fn training(changes: &Value) -> Value {
    let mut spec = json!({
        "kind": "train",
        "data": {"stream": {"preset": "D1-multisine", "samples": 48}},
        "context": 32,
        "model": {"preset": "robomorph-tiny", "patch": 4},
        "batch_size": 8,
        "steps": 12,
        "optimizer": {"warmup_steps": 0},
        "validate_every_steps": 10,
        "validation_trajectories": 16,
    });
    spec.as_object_mut().unwrap().extend(changes.as_object().unwrap().clone());
    spec
}

/// A training, and one that begins with its weights on a dataset and a stream, and whose encoder
/// does not change.
fn pipeline(steps: u32) -> Value {
    let fine_tuning = training(&json!({
        "data": [{"job": "data"}, {"stream": {"preset": "D1-chirp", "samples": 48}}],
        "data_weights": [1, 3],
        "init": {"job": "earlier"},
        "frozen": ["encoder_blocks", "encoder_input"],
        "steps": steps,
        "ema": {},
        "optimizer": {"learning_rate": 1e-4},
        "execution": {"max_attempts": 20},
    }));
    json!({
        "kind": "pipeline", "name": "fine-tuning", "jobs": {
            "data": data(3),
            "earlier": training(&json!({})),
            "fine-tuning": fine_tuning,
            "evaluate": {
                "kind": "evaluate", "data": {"stream": data(9)}, "context": 32,
                "checkpoints": [{"job": "earlier"}, {"job": "fine-tuning"}, {"best": {"job": "fine-tuning"}}],
                "bootstrap": {"resamples": 100},
            },
        },
    })
}

/// The files of the newest checkpoint of a job: their digests by name.
async fn newest_files(product: &Product, job: i64) -> Value {
    let job = product.get(&format!("/v1/jobs/{job}")).await;
    let id = job["checkpoints"].as_array().unwrap().last().unwrap().clone();
    let checkpoint = product.get(&format!("/v1/checkpoints/{id}")).await;
    let files = checkpoint["files"].as_array().unwrap().iter();
    // The description names the run.
    let files = files.filter(|file| file["name"] != "training.json");
    files.map(|file| json!([file["name"], file["sha256"]])).collect()
}

async fn config(product: &Product, job: i64) -> Value {
    let job = product.get(&format!("/v1/jobs/{job}")).await;
    let id = job["checkpoints"].as_array().unwrap().last().unwrap().clone();
    product.get(&format!("/v1/checkpoints/{id}/files/config.json")).await
}

#[tokio::test]
async fn a_fine_tuning_that_is_killed_ends_with_the_same_bits_and_says_where_it_came_from() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let id = product.submit(&pipeline(200)).await;
    let undisturbed = product.succeeded(id).await;
    let [earlier, tuned] = ["earlier", "fine-tuning"].map(|name| member(&undisturbed, name));
    let expected = newest_files(&product, tuned).await;

    let config = config(&product, tuned).await;
    let job = product.get(&format!("/v1/jobs/{earlier}")).await;
    assert_eq!(config["init"], json!({"spec_digest": job["digest"], "step": 12}));
    assert_eq!((&config["step"], &config["ema"]["power"]), (&json!(200), &json!(0.75)));

    // The weights that it began with are validated before the first step.
    let job = product.get(&format!("/v1/jobs/{tuned}")).await;
    let path = format!("/v1/runs/{}/metrics/validation/rmse_deg", job["run"]);
    let steps: Vec<u64> = product.get(&path).await["points"]
        .as_array()
        .unwrap()
        .iter()
        .map(|point| point["step"].as_u64().unwrap())
        .collect();
    assert_eq!(steps[..3], [0, 10, 20]);

    let evaluation = member(&undisturbed, "evaluate");
    let report = product.get(&format!("/v1/evaluations/{evaluation}")).await["report"].clone();
    let names: Vec<&str> = report["predictors"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|predictor| predictor["kind"] == "checkpoint")
        .map(|predictor| predictor["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["earlier", "fine-tuning", "robomorph (best)"]);
    drop(product);

    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let id = product.submit(&pipeline(200)).await;
    let began = Instant::now();
    let mut killed = 0;
    while killed < 3 {
        assert!(began.elapsed() < Duration::from_secs(120), "the fine-tuning never began");
        let jobs = product.get(&format!("/v1/jobs/{id}")).await;
        let tuned = product.get(&format!("/v1/jobs/{}", member(&jobs, "fine-tuning"))).await;
        if tuned["state"] == "succeeded" {
            break;
        }
        if tuned["progress"]["done"].as_u64() > Some(20 * killed) {
            product.kill_worker().await;
            killed += 1;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(killed > 0, "the fine-tuning ended before a kill");
    let disturbed = product.succeeded(id).await;
    assert_eq!(newest_files(&product, member(&disturbed, "fine-tuning")).await, expected);
}

#[tokio::test]
async fn a_fine_tuning_of_another_model_is_refused_at_submission() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start(folder.path());
    let id = product.submit(&training(&json!({"steps": 1}))).await;
    let job = product.succeeded(id).await;
    let checkpoint = &job["checkpoints"][0];
    for (changes, parts) in [
        (
            json!({"model": {"preset": "cdt-tiny", "patch": 4}}),
            vec!["model.architecture is cdt, allowed: robomorph"],
        ),
        (json!({"context": 16}), vec!["context is 16, allowed: 32"]),
        (
            json!({"data": {"stream": {"preset": "D1-multisine", "samples": 48, "rate_hz": 50}}}),
            vec!["rate_hz is 50, allowed: 60"],
        ),
        (json!({"normalization": "none"}), vec!["normalization is none, allowed: context"]),
        (json!({"frozen": ["decoder"]}), vec!["frozen[0]", "decoder_blocks"]),
        (json!({"init": {"checkpoint": 99}}), vec!["init.checkpoint", "99"]),
    ] {
        let mut spec = training(&json!({"init": {"checkpoint": checkpoint}}));
        spec.as_object_mut().unwrap().extend(changes.as_object().unwrap().clone());
        let (status, answer) = product.post("/v1/jobs", spec.to_string()).await;
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{answer}");
        for part in parts {
            assert!(answer.to_string().contains(part), "{part}: {answer}");
        }
    }
    // A parameter that does not exist is known only when the model is built.
    let wrong = training(&json!({
        "init": {"checkpoint": checkpoint}, "frozen": ["encoder_blocks.99"], "steps": 2,
    }));
    let id = product.submit(&wrong).await;
    let failed = product.finished(id).await;
    let error = failed.to_string();
    assert!(error.contains("frozen[0]") && error.contains("encoder_blocks.0"), "{error}");
}
