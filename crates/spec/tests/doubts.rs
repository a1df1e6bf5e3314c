//! Warnings about values that are allowed, for readers of the results.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

use serde_json::{Value, json};
use spec::{JobSpec, parse};

fn sentences(spec: &JobSpec) -> Vec<String> {
    spec.doubts().iter().map(ToString::to_string).collect()
}

fn of(spec: &Value) -> Vec<String> {
    sentences(&parse(spec.to_string().as_bytes()).unwrap())
}

#[test]
fn light_damping_is_doubted_wherever_the_simulation_is() {
    let light = json!({"preset": "D1-chirp", "robot": {"damping_nm_s_rad": vec![0.5; 7]}});
    let simulation = of(&light);
    assert!(simulation[0].starts_with("robot.damping_nm_s_rad is "), "{simulation:?}");

    let jobs = json!({"fine": {"preset": "D1-chirp"}, "light": light});
    let pipeline = of(&json!({"kind": "pipeline", "name": "two", "jobs": jobs}));
    assert_eq!(pipeline[0], format!("jobs.light.{}", simulation[0]));

    let training = of(&json!({
        "kind": "train", "steps": 5, "model": {"preset": "robomorph-tiny"},
        "data": {"stream": light},
    }));
    assert_eq!(training[0], format!("data.stream.{}", simulation[0]));
}

#[test]
fn no_preset_is_doubted() {
    for preset in spec::presets() {
        if let Ok(spec) = serde_json::from_value(preset.spec.clone()) {
            assert_eq!(sentences(&spec), Vec::<String>::new(), "{}", preset.name);
        }
    }
}
