//! The preset of the paper's architectures with smaller numbers, and with a flow in addition.

use serde_json::json;

use crate::product::{Product, run_to_end, torqued};

#[test]
fn all_architectures_are_trained_and_compared_by_one_preset() {
    let data = tempfile::tempdir().unwrap();
    let product = Product::start(data.path());
    let short = json!({
        "batch_size": 16, "steps": 3, "optimizer": {"warmup_steps": 0},
    });
    let flow = json!({
        "kind": "train", "data": {"job": "train-set"}, "model": {"preset": "flow-tiny"},
        "batch_size": 16, "steps": 3,
    });
    let checkpoints =
        ["robomorph", "diffuser", "cdcnn", "cdt", "flow"].map(|job| json!({"job": job}));
    let spec = json!({"preset": "four-models", "jobs": {
        "train-set": {"trajectories": 64},
        "test-grid": {"trajectories": 14},
        "robomorph": short, "diffuser": short, "cdcnn": short, "cdt": short, "flow": flow,
        "evaluate": {"checkpoints": checkpoints},
    }});
    let file = data.path().join("spec.json");
    std::fs::write(&file, spec.to_string()).unwrap();
    let mut submit = torqued(&["submit", "--watch", "--server", &product.url]);
    let (code, table, progress) = run_to_end(submit.arg(&file));
    assert_eq!(code, Some(0), "{table}\n{progress}");
    for predictor in ["hold-last", "robomorph", "diffuser", "cdcnn", "cdt", "flow"] {
        let rows = table.lines().filter(|line| line.starts_with(&format!("{predictor} ")));
        // Each occurs in two tables, and a model also in a sentence.
        assert!(rows.count() >= 2, "{predictor} is not in\n{table}");
    }
    for model in ["robomorph", "diffuser", "cdcnn", "cdt", "flow"] {
        assert!(table.lines().any(|line| line.starts_with(&format!("{model} is "))), "{table}");
    }
}
