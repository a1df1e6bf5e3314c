//! A checkpoint predicts while its server runs.

use std::io::{Seek as _, Write as _};

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::product::{Product, run_to_end, torqued};

/// Runs `torqued stream` with messages on its standard input, and gives its exit code and answers.
fn stream(product: &Product, checkpoint: &Value, messages: &[Value]) -> (Option<i32>, Vec<Value>) {
    let mut file = tempfile::tempfile().unwrap();
    messages.iter().for_each(|message| writeln!(file, "{message}").unwrap());
    file.rewind().unwrap();
    let mut command = torqued(&["stream", &checkpoint.to_string(), "--server", &product.url]);
    let (code, output, _) = run_to_end(command.stdin(file));
    (code, output.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

#[tokio::test]
async fn a_trained_checkpoint_predicts_at_once_and_the_same_after_a_restart() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let training = json!({
        "kind": "train", "context": 40, "batch_size": 4, "steps": 2,
        "data": {"stream": {"preset": "D1-multisine", "samples": 60}},
        "optimizer": {"warmup_steps": 0}, "validation_trajectories": 4,
        "model": {"preset": "cdt-tiny"}, "sampled_trajectories": 1,
    });
    let job = product.submit(&training).await;
    let checkpoint = product.succeeded(job).await["checkpoints"][0].clone();
    let path = format!("/v1/checkpoints/{checkpoint}/predict");
    let rows = |count: usize, value: f64| vec![[value; 7]; count];
    let question = |horizon: usize| {
        let scenario =
            json!({"u": rows(40, 0.5), "y": rows(40, 0.1), "future_u": rows(horizon, 1.0)});
        json!({"scenarios": [scenario], "sampling": {"samples": 3, "quantiles": [0.5]}}).to_string()
    };
    let (status, answer) = product.post(&path, question(20)).await;
    assert_eq!(status, StatusCode::OK, "{answer}");
    let shape = |rows: &Value| rows.as_array().unwrap().len();
    assert_eq!(shape(&answer["scenarios"][0]["y"]), 20);
    let (status, problem) = product.post(&path, question(21)).await;
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY);
    assert_eq!(problem["violations"][0]["field"], "scenarios[0].future_u", "{problem}");

    let step = json!({"step": {"u": rows(40, 0.5), "y": rows(40, 0.1), "future_u": rows(20, 1.0)}});
    let settings = json!({"open": {"sampling": {"samples": 3, "quantiles": [0.5]}}});
    let messages = [settings, step, json!({"reset": {}})];
    let (code, answers) = stream(&product, &checkpoint, &messages);
    assert_eq!(code, Some(0), "{answers:?}");
    assert_eq!(answers[0]["opened"]["horizon"], 20);
    assert_eq!(shape(&answers[1]["prediction"]["y"]), 20);
    assert_eq!(answers[2]["context"]["filled"], 0);
    let refused = json!({"step": {"u": rows(1, 0.5), "y": rows(2, 0.1)}});
    let (code, answers) = stream(&product, &checkpoint, &[json!({"open": {}}), refused]);
    assert_eq!((code, answers.len()), (Some(1), 2), "{answers:?}");
    assert_eq!(answers[1]["error"]["status"], 422);

    assert_eq!(product.end_by("TERM").0, Some(0));
    let product =
        Product::start_with(data.path(), &["--workers", "0", "--prediction-threads", "1"]);
    let (status, again) = product.post(&path, question(20)).await;
    assert_eq!(status, StatusCode::OK, "{again}");
    assert_eq!(again["scenarios"], answer["scenarios"], "whatever the threads");
    assert_eq!(again["threads"], 1);
}
