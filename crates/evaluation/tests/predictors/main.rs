//! Tests of predictors on simulated arms.

#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

mod baselines;
mod control;
mod feed_forward;
mod learned;
mod no_leak;
#[path = "../../../models/tests/smallest/mod.rs"]
mod smallest;

use std::ops::ControlFlow;

use evaluation::NominalArm;
use models::{Device, TrainedModel, Trainer, TrainingData};
use serde_json::{Value, json};
use series::Series;
use spec::{DataSpec, JobSpec, SimulateSpec, TrainSpec};

/// Joints of the Panda.
const JOINTS: usize = 7;

/// A checked simulation of `samples` samples with `fields` merged over it.
fn simulation(samples: usize, fields: &Value) -> SimulateSpec {
    let mut text = json!({
        "kind": "simulate", "trajectories": 100, "seed": 11, "samples": samples,
        "excitation": {"multisine": {"frequency_hz": {"fixed": 0.3}}},
    });
    text.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    match spec::parse(text.to_string().as_bytes()).unwrap() {
        JobSpec::Simulate(spec) => spec,
        _ => panic!("not a simulation"),
    }
}

fn arm(spec: &SimulateSpec) -> NominalArm {
    NominalArm::of(&DataSpec::Simulation(spec.clone()))
}

/// The first `count` trajectories.
fn scenarios(spec: &SimulateSpec, count: u64) -> Series {
    let simulated = dynamics::simulate(spec, 0..count, &|_| ControlFlow::Continue(())).unwrap();
    simulated.series
}

const CONTEXT: usize = 16;
const SAMPLES: usize = 24;
/// A number of sampler steps that the smallest models support.
const STEPS: u32 = 3;

/// A model that was trained for a few steps, so that every weight has moved.
fn trained(model: &Value) -> TrainedModel {
    trained_with(model, &json!({}))
}

/// The same training with `fields` merged over it.
fn trained_with(model: &Value, fields: &Value) -> TrainedModel {
    let spec = train_spec(model, fields);
    let samples = u32::try_from(SAMPLES).unwrap();
    let data = TrainingData { samples, joints: JOINTS, rate_hz: 60.0, statistics: None };
    let mut trainer = Trainer::new(&spec, data, "digest", &Device::cpu()).unwrap();
    let batch = scenarios(&simulation(SAMPLES, &json!({"seed": 12})), 8);
    for _ in 0..3 {
        trainer.step(&batch).unwrap();
    }
    TrainedModel::from_files(&trainer.checkpoint().unwrap(), &Device::cpu()).unwrap()
}

fn train_spec(model: &Value, fields: &Value) -> TrainSpec {
    let mut text = json!({
        "kind": "train", "data": {"dataset": 1}, "model": model, "context": CONTEXT,
        "steps": 3, "batch_size": 8, "seed": 1,
        "optimizer": {"learning_rate": 1e-3, "warmup_steps": 0},
    });
    text.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    match spec::parse(text.to_string().as_bytes()).unwrap() {
        JobSpec::Train(spec) => spec,
        _ => panic!("not a training"),
    }
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Copies `scenarios` and replaces every position after the first `known` samples.
fn with_horizon(scenarios: &Series, known: usize, value: impl Fn(usize) -> f32) -> Series {
    let mut replaced = scenarios.clone();
    let row = scenarios.shape().values_per_robot();
    for trajectory in replaced.y_mut().chunks_exact_mut(row) {
        for (k, y) in trajectory[known * JOINTS..].iter_mut().enumerate() {
            *y = value(k);
        }
    }
    replaced
}
