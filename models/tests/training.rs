//! What a training promises: that it learns, repeats, resumes exactly and says when it fails.

#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

mod synthetic;

use models::{CheckpointFiles, Device, ModelError, StatisticsAccumulator, Trainer, TrainingData};
use spec::{Normalization, TrainSpec};
use synthetic::{CONTEXT, DATA, batch, train_spec};

fn trainer(spec: &TrainSpec) -> Trainer {
    Trainer::new(spec, DATA, "digest", &Device::cpu()).unwrap()
}

/// Steps `from..to`, batch number = step number.
fn train(trainer: &mut Trainer, from: u64, to: u64) {
    for step in from..to {
        trainer.step(&batch(step, 8)).unwrap();
    }
}

fn checkpoint_after(spec: &TrainSpec, steps: u64) -> CheckpointFiles {
    let mut trainer = trainer(spec);
    train(&mut trainer, 0, steps);
    trainer.checkpoint().unwrap()
}

#[test]
fn training_lowers_the_validation_error() {
    let spec = TrainSpec { steps: 400, ..train_spec() };
    let mut trainer = trainer(&spec);
    let held_out = batch(1_000_000, 32);
    let before = trainer.validate(&held_out).unwrap();
    train(&mut trainer, 0, 400);
    let after = trainer.validate(&held_out).unwrap();
    assert!(after.loss < 0.5 * before.loss, "{before:?} {after:?}");
    assert!(after.rmse_rad < 0.6 * before.rmse_rad, "{before:?} {after:?}");
}

#[test]
fn the_same_spec_and_batches_give_the_same_bytes() {
    assert_eq!(checkpoint_after(&train_spec(), 6), checkpoint_after(&train_spec(), 6));
}

#[test]
fn another_seed_gives_other_weights() {
    let other = TrainSpec { seed: 8, ..train_spec() };
    assert_ne!(checkpoint_after(&train_spec(), 0).model, checkpoint_after(&other, 0).model);
}

#[test]
fn a_resumed_training_equals_an_uninterrupted_one_bit_for_bit() {
    for normalization in [Normalization::Context, Normalization::Dataset, Normalization::PaperLeaky]
    {
        let spec = TrainSpec { normalization, ..train_spec() };
        let data = TrainingData { statistics: Some(statistics()), ..DATA };
        let device = Device::cpu();
        let mut uninterrupted = Trainer::new(&spec, data, "digest", &device).unwrap();
        train(&mut uninterrupted, 0, 9);

        let mut interrupted = Trainer::new(&spec, data, "digest", &device).unwrap();
        train(&mut interrupted, 0, 4);
        let files = interrupted.checkpoint().unwrap();
        let mut resumed = Trainer::resume(&spec, data, "digest", &files, &device).unwrap();
        assert_eq!(resumed.steps_done(), 4);
        assert_eq!(resumed.checkpoint().unwrap(), files);
        train(&mut resumed, 4, 9);

        assert_eq!(resumed.checkpoint().unwrap(), uninterrupted.checkpoint().unwrap());
    }
}

#[test]
fn validation_changes_nothing() {
    let mut validated = trainer(&train_spec());
    for step in 0..4 {
        validated.validate(&batch(99, 3)).unwrap();
        validated.step(&batch(step, 8)).unwrap();
    }
    assert_eq!(validated.checkpoint().unwrap(), checkpoint_after(&train_spec(), 4));
}

#[test]
fn a_checkpoint_of_another_training_is_refused() {
    let files = checkpoint_after(&train_spec(), 1);
    let spec = train_spec();
    let device = Device::cpu();
    let Err(error) = Trainer::resume(&spec, DATA, "another", &files, &device) else {
        panic!("resumed from a checkpoint of another spec");
    };
    assert!(matches!(error, ModelError::OtherTraining { field: "spec", .. }), "{error}");
}

#[test]
fn a_loss_that_is_not_finite_names_its_step_and_leaves_the_trainer_as_it_was() {
    let mut trainer = trainer(&train_spec());
    train(&mut trainer, 0, 2);
    let before = trainer.checkpoint().unwrap();
    let mut huge = batch(2, 8);
    for y in huge.y.chunks_exact_mut(huge.samples * 7) {
        for value in &mut y[CONTEXT as usize * 7..] {
            *value = 1e30;
        }
    }
    let error = trainer.step(&huge).unwrap_err();
    assert!(error.to_string().starts_with("step 3: the loss is inf"), "{error}");
    assert_eq!(trainer.checkpoint().unwrap(), before);
}

#[test]
fn batches_of_the_wrong_shape_or_with_nan_are_refused() {
    let mut trainer = trainer(&train_spec());
    let mut short = batch(0, 2);
    short.u.pop();
    assert!(matches!(trainer.step(&short), Err(ModelError::Length { what: "u", .. })));

    let mut long = batch(0, 2);
    long.samples += 1;
    assert!(matches!(trainer.step(&long), Err(ModelError::Samples { actual: 25, expected: 24 })));

    let mut poisoned = batch(0, 2);
    poisoned.y[200] = f32::NAN;
    assert!(matches!(
        trainer.step(&poisoned),
        Err(ModelError::NotFiniteInput { what: "y", trajectory: 1 })
    ));

    let empty = models::Batch { u: Vec::new(), y: Vec::new(), size: 0, samples: 24 };
    assert!(trainer.step(&empty).is_err());
}

#[test]
fn dataset_normalization_without_statistics_is_refused() {
    let spec = TrainSpec { normalization: Normalization::Dataset, ..train_spec() };
    let result = Trainer::new(&spec, DATA, "digest", &Device::cpu());
    assert!(matches!(result, Err(ModelError::MissingStatistics)));
}

fn statistics() -> models::Statistics {
    let mut accumulator = StatisticsAccumulator::default();
    for index in 0..10 {
        let batch = batch(index, 8);
        accumulator.add(&batch.u, &batch.y);
    }
    accumulator.finish()
}
