//! Tests of the crate's public interface.

#![expect(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test that panics fails, which is what it should do; its numbers are small"
)]

mod accuracy;
mod calibration;
mod closed_loop;
mod determinism;
mod equations;
mod feed_forward;
mod measurement;
mod observations;
mod other_arms;
mod replay;
mod scenarios;
mod simulated_alone;
mod stability;

use std::ops::{ControlFlow, Range};

use dynamics::{DynamicsError, Trajectories, simulate};
use serde_json::{Value, json};
use spec::{JobSpec, SimulateSpec};

/// Joints of the Panda.
const JOINTS: usize = 7;

/// A checked spec: `fields` over a small simulation with the given excitation.
fn spec(excitation: &Value, fields: &Value) -> SimulateSpec {
    let mut spec =
        json!({"kind": "simulate", "trajectories": 1000, "seed": 3, "excitation": excitation});
    let object = spec.as_object_mut().unwrap();
    object.extend(fields.as_object().unwrap().clone());
    match spec::parse(spec.to_string().as_bytes()).unwrap() {
        JobSpec::Simulate(spec) => spec,
        _ => panic!("not a simulation"),
    }
}

fn chirp(frequency_hz: f64) -> Value {
    json!({"chirp": {"frequency_hz": {"fixed": frequency_hz}}})
}

fn multisine(frequency_hz: f64) -> Value {
    json!({"multisine": {"frequency_hz": {"fixed": frequency_hz}}})
}

/// Both excitation families, with chirps of low frequency, which are often rejected.
fn mixed() -> Value {
    json!({
        "chirp": {"frequency_hz": {"uniform": [0.05, 0.15]}},
        "multisine": {"frequency_hz": {"uniform": [0.05, 0.45]}},
    })
}

fn run(spec: &SimulateSpec, range: Range<u64>) -> Trajectories {
    simulate(spec, range, &|_| ControlFlow::Continue(())).unwrap()
}

fn failure(spec: &SimulateSpec, range: Range<u64>) -> DynamicsError {
    match simulate(spec, range, &|_| ControlFlow::Continue(())) {
        Ok(_) => panic!("the simulation should have failed"),
        Err(error) => error,
    }
}
