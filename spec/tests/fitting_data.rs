//! Trainings that do not fit their data are refused with both numbers.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use serde_json::json;
use spec::{DataSpec, JobSpec, TrainSpec};

fn data(samples: u32) -> DataSpec {
    let job = json!({"preset": "D1-chirp", "trajectories": 1000, "samples": samples});
    DataSpec::of(&spec::parse(job.to_string().as_bytes()).unwrap()).unwrap()
}

fn train(preset: &str) -> TrainSpec {
    let job = json!({
        "kind": "train",
        "data": {"dataset": 1},
        "model": {"preset": preset},
        "context": 320,
        "steps": 10,
    });
    match spec::parse(job.to_string().as_bytes()).unwrap() {
        JobSpec::Train(train) => train,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_u_net_needs_samples_that_it_can_halve() {
    for preset in ["diffuser-tiny", "cdcnn-tiny", "flow-tiny"] {
        train(preset).check_data(&data(408)).unwrap();
        let error = train(preset).check_data(&data(404)).unwrap_err().to_string();
        assert!(error.contains("stride 8") && error.contains("which are 404"), "{error}");
    }
    train("cdt-tiny").check_data(&data(401)).unwrap();
}

#[test]
fn a_patch_has_to_divide_the_horizon() {
    let error = train("robomorph-tiny").check_data(&data(401)).unwrap_err().to_string();
    assert!(error.contains("model.patch is 10") && error.contains("which is 81"), "{error}");
}
