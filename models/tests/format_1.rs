//! What torqued wrote before denoisers, averaged weights and metrics were in the format. The
//! files are of version 1's own making: a training of `synthetic::train_spec` after three steps,
//! what it predicted, and its weights one step later.

#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

mod synthetic;

use std::path::PathBuf;

use models::{CheckpointFiles, Device, TrainedModel, Trainer};
use safetensors::SafeTensors;
use synthetic::{CONTEXT, DATA, batch, train_spec};

fn read(file: &str) -> Vec<u8> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/format_1");
    std::fs::read(folder.join(file)).unwrap()
}

fn files() -> CheckpointFiles {
    CheckpointFiles {
        model: read("model.safetensors"),
        optimizer: read("optimizer.safetensors"),
        config: read("config.json"),
    }
}

fn numbers(bytes: &[u8]) -> Vec<f32> {
    let (numbers, rest) = bytes.as_chunks::<4>();
    assert!(rest.is_empty());
    numbers.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
}

/// Other processors, and other kernels than version 1's, round otherwise, so not to the bit.
const ROUNDING: f32 = 1e-5;

#[track_caller]
fn check_close(what: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < tolerance, "{what}: {found}, expected {expected}");
    }
}

#[test]
fn an_old_checkpoint_predicts_what_it_did() {
    let model = TrainedModel::from_files(&files(), &Device::cpu()).unwrap();
    assert_eq!(model.config().format_version, 1);
    let batch = batch(50, 2);
    let predicted = model.predict(&batch.observed(CONTEXT as usize)).unwrap();
    check_close("prediction", &predicted, &numbers(&read("prediction.f32")), ROUNDING);
}

/// The learning rate of `synthetic::train_spec`, about the size of a step.
const STEP: f32 = 3e-3;

#[test]
fn an_old_training_goes_on_as_it_would_have() {
    let mut trainer =
        Trainer::resume(&train_spec(), DATA, "digest", &files(), &Device::cpu()).unwrap();
    trainer.step(&batch(3, 8)).unwrap();
    let resumed = trainer.checkpoint().unwrap();
    let found = SafeTensors::deserialize(&resumed.model).unwrap();
    let bytes = read("next_model.safetensors");
    for (name, view) in SafeTensors::deserialize(&bytes).unwrap().iter() {
        let found = numbers(found.tensor(name).unwrap().data());
        // Softmax does not see what is added to every key: the gradient of their bias is nothing
        // but rounding, of which Adam makes steps of some size all the same.
        let tolerance = if name.ends_with("key.bias") { STEP } else { ROUNDING };
        check_close(name, &found, &numbers(view.data()), tolerance);
    }
}
