//! A law that finds the lengths and axes of its arm before its first step.

use models::{Device, InitialCheckpoint, TrainedModel, Trainer, TrainingData};
use serde_json::json;
use series::{Series, Shape};
use spec::TrainSpec;

use crate::synthetic::{DATA, training_of};

const JOINTS: usize = 2;
const SAMPLES: u32 = 70;
const CONTEXT: u32 = 50;

/// Two joints about one axis, which move on their own masses against damping.
fn batch(index: u64) -> Series {
    let robots = 8;
    let (mut u, mut y) = (Vec::new(), Vec::new());
    for robot in 0..robots {
        let rate = 0.1 + 0.01 * robot as f32 + 0.003 * index as f32;
        let (mut position, mut velocity) = ([0.2_f32, -0.3], [0.0_f32; JOINTS]);
        for sample in 0..SAMPLES {
            for joint in 0..JOINTS {
                let torque = 3.0 * (rate * (1.0 + joint as f32) * sample as f32).sin();
                u.push(torque);
                y.push(position[joint]);
                velocity[joint] += (torque - 2.0 * velocity[joint]) / 0.4 / 60.0;
                position[joint] += velocity[joint] / 60.0;
            }
        }
    }
    let shape = Shape { robots, samples: SAMPLES as usize, joints: JOINTS };
    Series::new(shape, DATA.rate_hz, u, y).unwrap()
}

fn training(steps: u64) -> TrainSpec {
    let model = json!({"architecture": "lagrangian", "chain": {"gravity": "off"}, "points": 8});
    let spec = training_of(serde_json::from_value(model).unwrap());
    TrainSpec { context: CONTEXT, steps, ..spec }
}

fn data() -> TrainingData {
    TrainingData { samples: SAMPLES, joints: JOINTS, ..DATA }
}

/// The weights of a checkpoint by name.
fn weights(file: &[u8]) -> Vec<(String, Vec<u8>)> {
    let tensors = safetensors::SafeTensors::deserialize(file).unwrap();
    let each = tensors.tensors().into_iter();
    each.map(|(name, tensor)| (name, tensor.data().to_vec())).collect()
}

fn chain(trainer: &Trainer) -> Vec<u8> {
    let weights = weights(&trainer.checkpoint().unwrap().model);
    weights.into_iter().find(|(name, _)| name == "chain.places").unwrap().1
}

#[test]
fn the_chain_of_the_first_batch_stays_and_a_resumed_training_goes_on_bit_for_bit() {
    let (spec, device) = (training(6), Device::cpu());
    let mut whole = Trainer::new(&spec, data(), "digest", &device).unwrap();
    let before = chain(&whole);
    whole.step(&batch(0)).unwrap();
    let found = chain(&whole);
    assert_ne!(found, before);
    let files = whole.checkpoint().unwrap();
    for index in 1..6 {
        whole.step(&batch(index)).unwrap();
    }
    assert_eq!(chain(&whole), found);

    let mut resumed = Trainer::resume(&spec, data(), "digest", &files, &device).unwrap();
    for index in 1..6 {
        resumed.step(&batch(index)).unwrap();
    }
    let files = whole.checkpoint().unwrap();
    assert!(resumed.checkpoint().unwrap() == files);
    let model = TrainedModel::from_files(&files, &device).unwrap();
    let known = batch(9);
    let answer = model.predict(&known.observed(CONTEXT as usize)).unwrap();
    assert!(answer.iter().all(|position| position.is_finite()));
}

#[test]
fn a_fine_tuning_keeps_the_chain_of_its_checkpoint() {
    let (spec, device) = (training(2), Device::cpu());
    let mut first = Trainer::new(&spec, data(), "digest", &device).unwrap();
    first.step(&batch(0)).unwrap();
    let files = first.checkpoint().unwrap();
    let init = InitialCheckpoint { model: files.model, config: files.config };
    let mut tuned = Trainer::fine_tune(&spec, data(), "digest", &init, &device).unwrap();
    tuned.step(&batch(40)).unwrap();
    assert_eq!(chain(&tuned), chain(&first));
}

#[test]
fn a_context_that_cannot_show_a_chain_is_refused() {
    let spec = TrainSpec { context: 29, ..training(2) };
    let refused = Trainer::new(&spec, data(), "digest", &Device::cpu()).err().unwrap().to_string();
    assert!(refused.contains("context is 29, allowed: 30"), "{refused}");
}
