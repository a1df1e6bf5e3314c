//! The same models on every device of the build. Their predictions, their losses and the gradient
//! of every parameter equal those of the processor up to rounding.

#![cfg(any(feature = "gpu", feature = "ndarray", feature = "torch"))]
#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

mod synthetic;

use std::collections::BTreeMap;

use models::{
    CheckpointConfig, CheckpointFiles, Device, DeviceKind, Sampling, TrainedModel, Trainer,
    ValidationPart,
};
use safetensors::SafeTensors;
use spec::{EmaSpec, ModelSpec, RoboMorphSpec, SamplerSpec, TrainSpec};
use synthetic::{CONTEXT, DATA, JOINTS, SAMPLES, batch, every_kind, kind, train_spec};

/// Relative to the largest gradient of the same parameter.
const GRADIENT_TOLERANCE: f32 = 5e-5;
/// The same of rotor inertias: the terms of their sums over samples cancel to a thousandth.
const ARMATURE_TOLERANCE: f32 = 1e-3;
/// Relative to a loss or a norm.
const SCALAR_TOLERANCE: f64 = 2e-6;
/// Relative to the largest predicted motion. It includes whole chains of a sampler.
const POSITION_TOLERANCE: f32 = 5e-5;

/// Every architecture with its options, and the Transformer with tokens of one sample. Not those
/// with bf16, which devices round to in places of their own, and where PyTorch draws the dropout of
/// attention, not those with dropout.
fn every_model(device: DeviceKind) -> Vec<(String, ModelSpec)> {
    let mut kinds = every_kind();
    kinds.retain(|(name, _)| !name.ends_with("bf16"));
    if device.keeps_plans_by_thread() {
        kinds.retain(|(name, _)| !name.ends_with("dropout"));
    }
    let ModelSpec::RoboMorph(robomorph) = kind("robomorph") else { panic!("not a RoboMorph") };
    let every_sample = ModelSpec::RoboMorph(RoboMorphSpec { patch: 1, ..robomorph });
    kinds.push(("robomorph, patch 1".to_owned(), every_sample));
    kinds
}

fn unclipped(model: ModelSpec) -> TrainSpec {
    let mut spec = TrainSpec { model, ..train_spec() };
    spec.optimizer.gradient_clip_norm = None;
    spec
}

fn trainer(spec: &TrainSpec, device: &Device) -> Trainer {
    Trainer::new(spec, DATA, "digest", device).unwrap()
}

/// Values of the tensors whose names begin with `prefix`.
fn tensors(file: &[u8], prefix: &str) -> BTreeMap<String, Vec<f32>> {
    let file = SafeTensors::deserialize(file).unwrap();
    let matching = file.iter().filter_map(|(name, view)| {
        let name = name.strip_prefix(prefix)?.to_owned();
        let (numbers, _) = view.data().as_chunks::<4>();
        Some((name, numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()))
    });
    matching.collect()
}

fn largest(values: impl Iterator<Item = f32>) -> f32 {
    // A NaN must not be lost, as it would be in `f32::max`.
    values.map(f32::abs).fold(0.0, |a, b| if b <= a { a } else { b })
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    largest(a.iter().zip(b).map(|(a, b)| a - b))
}

#[track_caller]
fn assert_close(name: &str, found: f64, expected: f64) {
    let difference = (found - expected).abs() / expected.abs();
    println!("{name}: {difference:.1e}");
    assert!(difference <= SCALAR_TOLERANCE, "{name}: {found}, on the processor {expected}");
}

/// Compares loss, gradient norm and all gradients of the first step. After it, Adam's first moment
/// is the gradient times a constant. Weights cannot be compared: Adam moves a weight by the
/// learning rate whatever the size of its gradient, and a gradient that is only rounding error has
/// a random sign.
fn check_gradients(kind: DeviceKind) {
    let device = Device::open(kind).unwrap();
    for (name, model) in every_model(kind) {
        let spec = unclipped(model);
        let (mut expected, mut found) = (trainer(&spec, &Device::cpu()), trainer(&spec, &device));
        let initial = (expected.checkpoint().unwrap(), found.checkpoint().unwrap());
        assert!(initial.0.model == initial.1.model, "{name}: initial weights differ");

        let batch = batch(0, 8);
        let reports = (expected.step(&batch).unwrap(), found.step(&batch).unwrap());
        assert_close(&format!("{name}, loss"), reports.1.loss, reports.0.loss);
        let norms = (reports.1.gradient_norm, reports.0.gradient_norm);
        assert_close(&format!("{name}, gradient norm"), norms.0, norms.1);

        let gradients =
            |trainer: &Trainer| tensors(&trainer.checkpoint().unwrap().optimizer, "exp_avg.");
        let (expected, found) = (gradients(&expected), gradients(&found));
        assert!(!expected.is_empty() && expected.keys().eq(found.keys()), "{name}");
        // A gradient that is zero up to rounding, such as that of a bias before a norm, is compared
        // with the size of the others.
        let overall = largest(expected.values().flatten().copied());
        let mut worst = (0.0, "");
        for (parameter, expected) in &expected {
            let scale = largest(expected.iter().copied()).max(1e-3 * overall);
            let difference = largest_difference(expected, &found[parameter]) / scale;
            let is_armature = parameter == "armature";
            let most = if is_armature { ARMATURE_TOLERANCE } else { GRADIENT_TOLERANCE };
            let is_close = difference <= most;
            assert!(is_close, "{name}: gradient of {parameter} is off by {difference}");
            if difference > worst.0 {
                worst = (difference, parameter);
            }
        }
        println!("{name}, gradients: {:.1e} in {}", worst.0, worst.1);
    }
}

/// Compares answers after a short training, and whole chains of every sampler.
fn check_answers(kind: DeviceKind) {
    let device = Device::open(kind).unwrap();
    let held_out = batch(50, 3);
    let question = held_out.observed(CONTEXT as usize);
    for (name, model) in every_model(kind) {
        let mut trainer = trainer(&unclipped(model), &Device::cpu());
        for step in 0..5 {
            trainer.step(&batch(step, 8)).unwrap();
        }
        let files = trainer.checkpoint().unwrap();
        let expected = TrainedModel::from_files(&files, &Device::cpu()).unwrap();
        let found = TrainedModel::from_files(&files, &device).unwrap();
        let compare = |what: &str, expected: Vec<f32>, found: Vec<f32>| {
            let difference = largest_difference(&expected, &found) / largest_motion(&expected);
            println!("{name}, {what}: {difference:.1e}");
            assert!(difference <= POSITION_TOLERANCE, "{name}, {what}: {difference}");
        };
        let answers = |model: &TrainedModel| model.predict(&question).unwrap();
        compare("prediction", answers(&expected), answers(&found));
        let Some(generation) = expected.architecture().generation() else { continue };
        for &kind in generation.samplers() {
            let sampler = Some(SamplerSpec { kind, steps: Some(6), ..SamplerSpec::default() });
            let sampling = Sampling { sampler, samples: 2, seed: 5, ..Sampling::default() };
            let samples = |model: &TrainedModel| model.sample(&question, &sampling).unwrap();
            compare(&format!("{kind:?}"), samples(&expected), samples(&found));
        }
    }
}

/// The largest motion of a joint within a predicted horizon.
fn largest_motion(positions: &[f32]) -> f32 {
    let horizon = (SAMPLES - CONTEXT) as usize * JOINTS;
    let from_first = |y: &[f32]| largest((JOINTS..horizon).map(|i| y[i] - y[i % JOINTS]));
    let motion = largest(positions.chunks_exact(horizon).map(from_first));
    assert!(motion > 0.0, "nothing moves");
    motion
}

/// Training continues from the checkpoint of another device: the same weights, then the same
/// losses.
fn check_exchange(kind: DeviceKind) {
    let there = Device::open(kind).unwrap();
    // Options change the computation, but not the checkpoint.
    for (name, model) in every_kind().into_iter().filter(|(name, _)| !name.contains(',')) {
        let ema = Some(EmaSpec { decay: 0.5, power: 1.0 });
        let spec = TrainSpec { model, ema, gradient_accumulation: 2, ..train_spec() };
        for (from, to) in [(&Device::cpu(), &there), (&there, &Device::cpu())] {
            let mut begun = trainer(&spec, from);
            for step in 0..3 {
                begun.step(&batch(step, 8)).unwrap();
            }
            let files = begun.checkpoint().unwrap();
            assert_eq!(device_in(&files), from.description().name);
            let mut resumed = Trainer::resume(&spec, DATA, "digest", &files, to).unwrap();
            let moved = resumed.checkpoint().unwrap();
            assert_eq!(device_in(&moved), to.description().name);
            assert!(moved.model == files.model, "{name}: weights changed on their way");
            assert!(moved.optimizer == files.optimizer, "{name}: moments changed on their way");

            let held_out = batch(51, 4);
            let validated =
                |trainer: &Trainer| trainer.validate(&ValidationPart::whole(&held_out)).unwrap();
            let (a, b) = (validated(&begun), validated(&resumed));
            assert_close(&format!("{name}, validation loss"), b.loss(), a.loss());
            let batch = batch(3, 8);
            let (a, b) = (begun.step(&batch).unwrap(), resumed.step(&batch).unwrap());
            assert_close(&format!("{name}, loss after the move"), b.loss, a.loss);
        }
    }
}

fn device_in(files: &CheckpointFiles) -> String {
    CheckpointConfig::parse(&files.config).unwrap().device.unwrap().name
}

/// A training that is repeated has the same weights, bit for bit.
fn check_repeats(kind: DeviceKind) {
    let device = Device::open(kind).unwrap();
    for (name, model) in every_kind() {
        let spec = TrainSpec { model, ..train_spec() };
        let [first, second] = [(); 2].map(|()| {
            let mut trainer = trainer(&spec, &device);
            for step in 0..10 {
                trainer.step(&batch(step, 8)).unwrap();
            }
            trainer.checkpoint().unwrap()
        });
        assert!(first.model == second.model, "{name}: other weights");
    }
}

/// A device that is opened again is the same one, and its first computation was right.
fn check_first_computation(kind: DeviceKind) {
    for _ in 0..2 {
        let device = Device::open(kind).unwrap();
        println!("{:?}", device.description());
        assert_eq!(device.kind(), kind);
        device.check().unwrap();
    }
}

/// The same tests of each device that the build has.
macro_rules! devices {
    ($($feature:literal $module:ident $kind:ident)*) => {
        $(
            #[cfg(feature = $feature)]
            mod $module {
                use super::*;

                #[test]
                fn a_first_computation_is_right() {
                    check_first_computation(DeviceKind::$kind);
                }

                #[test]
                fn losses_and_gradients_are_the_processors() {
                    check_gradients(DeviceKind::$kind);
                }

                #[test]
                fn answers_and_samples_are_the_processors() {
                    check_answers(DeviceKind::$kind);
                }

                #[test]
                fn a_training_repeats_itself() {
                    check_repeats(DeviceKind::$kind);
                }

                #[test]
                fn trainings_move_to_the_processor_and_back() {
                    check_exchange(DeviceKind::$kind);
                }
            }
        )*
    };
}

devices! {
    "gpu" gpu Gpu
    "ndarray" ndarray NdArray
    "torch" torch Torch
}

#[cfg(feature = "gpu")]
#[test]
fn a_gpu_has_a_name() {
    let description = Device::open(DeviceKind::Gpu).unwrap().description().clone();
    assert!(description.adapter.is_some_and(|adapter| !adapter.is_empty()));
}
