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
fn a_described_arm_is_doubted_without_its_friction_wherever_the_simulation_is() {
    let arm = include_str!("../../../tests/data/arm_of_six.json");
    let mut simulation = json!({
        "kind": "simulate", "trajectories": 2,
        "excitation": {"via_points": {"frequency_hz": {"fixed": 1}}},
        "controller": {"law": {"joint-pd": {}}},
        "robot": {"model": serde_json::from_str::<Value>(arm).unwrap()},
    });
    let doubt = "robot.friction is null: robot.model has friction of joints axis 1, axis 2, axis 3, axis 4, axis 5, \
                 axis 6, which this spec leaves out; say \"friction\": {} to simulate it";
    assert_eq!(of(&simulation), [doubt]);
    let stream = json!({"stream": simulation});
    for job in [
        json!({"kind": "train", "steps": 5, "model": {"preset": "robomorph-tiny"}, "data": stream}),
        json!({"kind": "evaluate", "baselines": ["hold-last"], "data": stream}),
        json!({"kind": "control", "baselines": ["nominal-simulator"], "data": stream}),
    ] {
        let found = of(&job);
        assert!(found.contains(&format!("data.stream.{doubt}")), "{found:?}");
    }

    let mut open_loop = simulation.clone();
    open_loop["controller"] = Value::Null;
    open_loop["excitation"] = json!({"chirp": {"frequency_hz": {"fixed": 0.3}}});
    assert_eq!(of(&open_loop).last().map(String::as_str), Some(doubt));

    simulation["robot"]["friction"] = json!({});
    assert_eq!(of(&simulation), Vec::<String>::new());
    simulation["robot"] = json!({"model": "ur10e"});
    assert_eq!(of(&simulation), Vec::<String>::new());
}

#[test]
fn no_preset_is_doubted() {
    for preset in spec::presets() {
        if let Ok(spec) = serde_json::from_value(preset.spec.clone()) {
            assert_eq!(sentences(&spec), Vec::<String>::new(), "{}", preset.name);
        }
    }
}
