//! The end, the results and the messages of a training.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use crate::product::{Product, member};

/// "Within two seconds", on a busy machine.
const SOON: Duration = Duration::from_secs(15);

fn stream() -> Value {
    json!({"stream": {"preset": "D1-multisine", "samples": 48}})
}

/// A denoiser with averaged weights that is stopped early, because 60 steps never improve it by a
/// hundred degrees.
fn stopped_early() -> Value {
    json!({
        "kind": "train",
        "data": stream(),
        "context": 32,
        "model": {"preset": "cdcnn-tiny", "widths": [16, 32]},
        "ema": {},
        "batch_size": 16,
        "gradient_accumulation": 2,
        "steps": 1000,
        "validate_every_steps": 15,
        "validation_trajectories": 24,
        "sampled_trajectories": 20,
        "early_stop": {"patience": 3, "min_delta": 100.0},
        "checkpoint_every_steps": 7,
        "keep_checkpoints": 1,
    })
}

async fn checkpoints(product: &Product, job: &Value) -> Vec<Value> {
    let mut found = Vec::new();
    for id in job["checkpoints"].as_array().unwrap() {
        found.push(product.get(&format!("/v1/checkpoints/{id}")).await);
    }
    found
}

/// Digests of every file of every checkpoint with a mark, and of every validation.
async fn results(product: &Product, job: &Value) -> Value {
    let mut all = Vec::new();
    for checkpoint in checkpoints(product, job).await {
        if checkpoint["best"] == true || checkpoint["final"] == true {
            let files = checkpoint["files"].as_array().unwrap();
            let digests: Vec<&Value> = files.iter().map(|file| &file["sha256"]).collect();
            all.push(json!([checkpoint["step"], checkpoint["metrics"], digests]));
        }
    }
    for key in ["validation/loss", "validation/rmse_deg"] {
        let metric = product.get(&format!("/v1/runs/{}/metrics/{key}", job["run"])).await;
        let points = metric["points"].as_array().unwrap().iter();
        all.push(points.map(|point| json!([point["step"], point["value"]])).collect());
    }
    all.into()
}

#[tokio::test]
async fn a_denoiser_that_is_killed_again_and_again_stops_early_with_the_same_bits() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let id = product.submit(&stopped_early()).await;
    let undisturbed = product.succeeded(id).await;
    let expected = results(&product, &undisturbed).await;
    let took = Duration::from_secs_f64(undisturbed["duration_seconds"].as_f64().unwrap());
    let progress = &undisturbed["progress"];
    assert_eq!((&progress["done"], &progress["total"]), (&json!(60), &json!(60)), "{progress}");
    let task = &product.get(&format!("/v1/jobs/{id}/tasks")).await["tasks"][0];
    let stopped = json!({"validations_without_improvement": 3});
    assert_eq!(task["result"]["stopped_early"], stopped, "{task:#}");
    let last = checkpoints(&product, &undisturbed).await.pop().unwrap();
    assert_eq!((&last["step"], &last["final"]), (&json!(60), &json!(true)));
    drop(product);

    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = stopped_early();
    spec["execution"] = json!({"max_attempts": 20});
    let id = product.submit(&spec).await;
    for attempt in 1..=3 {
        product
            .task_when(id, |task| {
                let begun = task["state"] == "running" && task["attempt"] == attempt;
                begun || task["state"] == "succeeded"
            })
            .await;
        let moment = took.mul_f64(random_fraction());
        eprintln!("SIGKILL {moment:?} into attempt {attempt}; undisturbed it takes {took:?}");
        tokio::time::sleep(moment).await;
        product.kill_worker().await;
    }
    let disturbed = product.succeeded(id).await;
    assert_eq!(results(&product, &disturbed).await, expected);
}

#[tokio::test]
async fn the_best_the_last_and_the_newest_checkpoints_are_kept_and_any_can_be_evaluated() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let grid = json!({
        "preset": "grid-multisine", "trajectories": 20, "samples": 48,
        "excitation": {"multisine": {"frequency_hz": {"grid": [0.15, 0.3]}}},
    });
    let mut train = stopped_early();
    train.as_object_mut().unwrap().remove("early_stop");
    train["steps"] = 40.into();
    // The learning rate is so large that the model does not stay at its best.
    train["optimizer"] = json!({"learning_rate": 0.3});
    let pipeline = json!({
        "kind": "pipeline", "name": "best", "jobs": {
            "grid": grid,
            "train": train,
            "evaluate": {
                "kind": "evaluate", "data": {"job": "grid"}, "context": 32, "baselines": [],
                "checkpoints": [{"job": "train"}, {"best": {"job": "train"}}],
            },
        },
    });
    let id = product.submit(&pipeline).await;
    let pipeline = product.succeeded(id).await;
    let training = product.get(&format!("/v1/jobs/{}", member(&pipeline, "train"))).await;
    let kept = checkpoints(&product, &training).await;
    let steps: Vec<u64> =
        kept.iter().map(|checkpoint| checkpoint["step"].as_u64().unwrap()).collect();
    let best = kept.iter().find(|checkpoint| checkpoint["best"] == true).unwrap();
    assert!(steps.len() <= 3 && steps.contains(&35) && steps.contains(&40), "{steps:?}");
    let last = kept.last().unwrap();
    assert_eq!((&last["final"], &last["last"]), (&json!(true), &json!(true)));
    let run = product.get(&format!("/v1/runs/{}", training["run"])).await;
    let path = format!("/v1/runs/{}/metrics/validation/rmse_deg", training["run"]);
    let points = product.get(&path).await["points"].as_array().unwrap().clone();
    let lowest = points.iter().map(|point| point["value"].as_f64().unwrap()).reduce(f64::min);
    assert_eq!(best["metrics"]["validation/rmse_deg"].as_f64(), lowest, "{points:?}");
    for key in ["train/seconds_per_step", "train/samples_per_second", "memory/resident_bytes"] {
        assert!(run["metrics"][key]["value"].as_f64() > Some(0.0), "{key}: {run:#}");
    }

    let by_id = product
        .submit(&json!({
            "kind": "evaluate", "data": {"stream": grid}, "context": 32, "baselines": [],
            "checkpoints": [{"checkpoint": best["id"]}],
        }))
        .await;
    product.succeeded(by_id).await;
    let by_id = product.get(&format!("/v1/evaluations/{by_id}")).await;
    let in_pipeline = member(&pipeline, "evaluate");
    let both = product.get(&format!("/v1/evaluations/{in_pipeline}")).await;
    let names: Vec<&Value> = both["report"]["predictors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|predictor| &predictor["name"])
        .collect();
    assert_eq!(names, ["cdcnn", "cdcnn (best)"]);
    for (alone, both) in cells(&by_id).iter().zip(cells(&both)) {
        let means = |cell: &Value, index: usize| cell["rmse_deg"][index]["mean"].clone();
        assert_eq!(means(alone, 0), means(&both, 1));
    }
}

fn cells(evaluation: &Value) -> Vec<Value> {
    evaluation["report"]["cells"].as_array().unwrap().clone()
}

#[tokio::test]
async fn a_training_that_diverges_fails_with_its_numbers_its_batch_and_its_last_checkpoint() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    // Adam without memory of the gradients' size, at the highest rate, diverges.
    let spec = json!({
        "kind": "train",
        "data": stream(),
        "context": 32,
        "model": {
            "architecture": "robomorph", "d_model": 8, "heads": 2, "encoder_layers": 1,
            "decoder_layers": 1, "patch": 4, "mlp_ratio": 2,
        },
        "optimizer": {"learning_rate": 1.0, "betas": [0.99, 0.0], "epsilon": 1e-12},
        "batch_size": 8,
        "steps": 5000,
        "validation_fraction": 0,
        "checkpoint_every_steps": 1,
    });
    let id = product.submit(&spec).await;
    let job = product.finished(id).await;
    assert_eq!(job["state"], "failed", "{job:#}");
    let error = job["error"].as_str().unwrap();
    for part in
        ["the training diverged at ", "the batch was trajectories ", " to ", "learning rate"]
    {
        assert!(error.contains(part), "{error:?} lacks {part:?}");
    }
    let tasks = product.get(&format!("/v1/jobs/{id}/tasks")).await;
    assert_eq!(tasks["tasks"][0]["attempt"], 1, "the same numbers would come again");
    let last = checkpoints(&product, &job).await.pop().unwrap();
    let named = format!("the last good checkpoint is {}, after step {}", last["id"], last["step"]);
    assert!(error.contains(&named), "{error:?} lacks {named:?}");
}

#[tokio::test]
async fn cancelling_in_a_long_validation_ends_soon_with_a_checkpoint() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let mut spec = stopped_early();
    // Its first validation would take a hundred million passes.
    spec["model"]["diffusion"] = json!({"steps": 10_000});
    spec["model"]["sampler"] = json!({"kind": "ddpm", "steps": 10_000});
    spec["validation_trajectories"] = 10_000.into();
    spec["sampled_trajectories"] = 10_000.into();
    spec["checkpoint_every_steps"] = 100.into();
    let id = product.submit(&spec).await;
    product.job_when(id, |job| job["progress"]["done"] == 15).await;
    let asked = Instant::now();
    product.post(&format!("/v1/jobs/{id}/cancel"), "").await;
    let job = product.finished(id).await;
    assert!(asked.elapsed() < SOON, "took {:?}", asked.elapsed());
    assert_eq!(job["state"], "cancelled");
    let kept = checkpoints(&product, &job).await;
    assert_eq!(kept.iter().map(|checkpoint| &checkpoint["step"]).collect::<Vec<_>>(), [15]);
}

/// A random number from 0 to 1. The caller prints it, because a failure may depend on it.
fn random_fraction() -> f64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    f64::from(now.subsec_nanos() % 10_007) / 10_007.0
}
