//! Invalid specs: the problem names the field and what is allowed, and nothing is queued.

use serde_json::{Value, json};

use crate::product::{Product, small_pipeline};

async fn refusal(product: &Product, spec: &str) -> Value {
    let (status, problem) = product.post("/v1/jobs", spec).await;
    assert!(status.is_client_error(), "{spec}: {status} {problem}");
    assert_eq!(problem["status"], status.as_u16(), "{problem:#}");
    for key in ["type", "title"] {
        assert!(problem[key].is_string(), "{spec}: no {key} in {problem:#}");
    }
    problem
}

#[tokio::test]
async fn a_bad_spec_is_answered_with_field_value_and_what_is_allowed() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let bad = [
        (json!({"preset": "D1-multisine", "trajectorys": 5}), "trajectorys"),
        (json!({"preset": "D1-multisine", "trajectories": -5}), "trajectories"),
        (json!({"preset": "D1-multisine", "trajectories": 1_000_000_000_000_u64}), "trajectories"),
        (json!({"preset": "D9-multisine"}), "D1-multisine"),
        (json!({"kind": "cook"}), "simulate"),
        (json!({"preset": "quickstart", "jobs": {"train": {"model": {"d_model": 7}}}}), "d_model"),
        (json!({"preset": "quickstart", "jobs": {"train": {"context": 395}}}), "context"),
    ];
    for (spec, expected) in bad {
        let problem = refusal(&product, &spec.to_string()).await;
        let violations = problem["violations"].as_array().unwrap_or_else(|| panic!("{problem:#}"));
        assert!(!violations.is_empty());
        for violation in violations {
            for key in ["field", "value", "allowed"] {
                assert!(violation[key].is_string(), "{problem:#}");
            }
        }
        assert!(problem.to_string().contains(expected), "{expected} is not in {problem:#}");
    }
    refusal(&product, r#"{"preset": "D1-multisine", "rate_hz": NaN}"#).await;
    refusal(&product, "").await;
    refusal(&product, &" ".repeat((1 << 20) + 1)).await;
    assert_eq!(product.get("/v1/jobs").await["jobs"], json!([]));
}

#[tokio::test]
async fn a_dataset_or_checkpoint_that_does_not_exist_is_refused() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let mut train = small_pipeline()["jobs"]["train"].clone();
    train["data"] = json!({"dataset": 4711});
    let problem = refusal(&product, &train.to_string()).await;
    assert!(problem.to_string().contains("4711"), "{problem:#}");

    let mut evaluate = small_pipeline();
    evaluate["jobs"]["evaluate"]["checkpoints"] = json!([{"checkpoint": 4712}]);
    let problem = refusal(&product, &evaluate.to_string()).await;
    assert!(problem.to_string().contains("4712"), "{problem:#}");

    evaluate["jobs"]["evaluate"]["checkpoints"] = json!([{"digest": "ab".repeat(32)}]);
    refusal(&product, &evaluate.to_string()).await;
    assert_eq!(product.get("/v1/jobs").await["jobs"], json!([]));
}

#[tokio::test]
async fn a_training_that_cannot_read_its_data_is_refused() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start_with(data.path(), &["--workers", "0"]);
    let mut spec = small_pipeline();
    spec["jobs"]["train"]["context"] = 60.into();
    let problem = refusal(&product, &spec.to_string()).await;
    assert!(problem["violations"][0]["field"].as_str().unwrap().contains("context"), "{problem:#}");
    assert_eq!(product.get("/v1/jobs").await["jobs"], json!([]));
}
