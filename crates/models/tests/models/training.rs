//! A training learns, repeats exactly, resumes exactly and reports failures.

use std::thread;
use std::time::Duration;

use models::{
    CheckpointConfig, CheckpointFiles, DataRanges, Device, Interrupt, ModelError,
    StatisticsAccumulator, Trainer, TrainingData, ValidationPart,
};
use series::{Series, Shape};
use spec::{Normalization, OptimizerSpec, TrainSpec};

use crate::synthetic::{CONTEXT, DATA, batch, train_spec};

fn trainer(spec: &TrainSpec) -> Trainer {
    Trainer::new(spec, DATA, "digest", &Device::cpu()).unwrap()
}

/// Takes the steps `from..to`. The batch number equals the step number.
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
    let before = trainer.validate(&ValidationPart::whole(&held_out)).unwrap();
    train(&mut trainer, 0, 400);
    let after = trainer.validate(&ValidationPart::whole(&held_out)).unwrap();
    assert!(after.loss() < 0.5 * before.loss(), "{before:?} {after:?}");
    assert!(after.rmse_rad() < 0.6 * before.rmse_rad(), "{before:?} {after:?}");
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
        let data = || TrainingData { statistics: Some(statistics()), ..DATA };
        let device = Device::cpu();
        let mut uninterrupted = Trainer::new(&spec, data(), "digest", &device).unwrap();
        train(&mut uninterrupted, 0, 9);

        let mut interrupted = Trainer::new(&spec, data(), "digest", &device).unwrap();
        train(&mut interrupted, 0, 4);
        let files = interrupted.checkpoint().unwrap();
        let mut resumed = Trainer::resume(&spec, data(), "digest", &files, &device).unwrap();
        assert_eq!(resumed.steps_done(), 4);
        assert_eq!(resumed.checkpoint().unwrap(), files);
        train(&mut resumed, 4, 9);

        assert_eq!(resumed.checkpoint().unwrap(), uninterrupted.checkpoint().unwrap());
    }
}

fn ranges(files: &CheckpointFiles) -> Option<DataRanges> {
    CheckpointConfig::parse(&files.config).unwrap().ranges
}

#[test]
fn a_checkpoint_says_the_ranges_of_all_that_it_was_trained_on() {
    let seen = (0..6).map(|step| DataRanges::of(&batch(step, 8).view()).unwrap());
    assert_eq!(ranges(&checkpoint_after(&train_spec(), 6)), seen.reduce(DataRanges::and));
    assert_eq!(ranges(&checkpoint_after(&train_spec(), 0)), None);
}

#[test]
fn a_training_that_goes_on_from_a_checkpoint_without_ranges_does_not_make_them_up() {
    let mut files = checkpoint_after(&train_spec(), 2);
    let mut config: serde_json::Value = serde_json::from_slice(&files.config).unwrap();
    config.as_object_mut().unwrap().remove("ranges").unwrap();
    files.config = serde_json::to_vec(&config).unwrap();
    let mut resumed =
        Trainer::resume(&train_spec(), DATA, "digest", &files, &Device::cpu()).unwrap();
    train(&mut resumed, 2, 4);
    assert_eq!(ranges(&resumed.checkpoint().unwrap()), None);
}

#[test]
fn validation_changes_nothing() {
    let mut validated = trainer(&train_spec());
    for step in 0..4 {
        validated.validate(&ValidationPart::whole(&batch(99, 3))).unwrap();
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
    let row = huge.shape().values_per_robot();
    for y in huge.y_mut().chunks_exact_mut(row) {
        for value in &mut y[CONTEXT as usize * 7..] {
            *value = 1e30;
        }
    }
    let error = trainer.step(&huge).unwrap_err();
    assert!(error.to_string().starts_with("step 3: the loss is inf"), "{error}");
    assert_eq!(trainer.checkpoint().unwrap(), before);
}

#[test]
fn an_interrupted_step_or_validation_leaves_the_trainer_as_it_was() {
    let interrupt = Interrupt::default();
    let mut interrupted = trainer(&train_spec()).interrupted_by(interrupt.clone());
    let ended = thread::scope(|scope| {
        scope.spawn(|| {
            thread::sleep(Duration::from_millis(30));
            interrupt.raise();
        });
        (0..).find_map(|step| interrupted.step(&batch(step, 8)).err()).unwrap()
    });
    assert!(matches!(ended, ModelError::Interrupted), "{ended}");
    let validated = interrupted.validate(&ValidationPart::whole(&batch(99, 8)));
    assert!(matches!(validated, Err(ModelError::Interrupted)));
    let expected = checkpoint_after(&train_spec(), interrupted.steps_done());
    assert_eq!(interrupted.checkpoint().unwrap(), expected);
}

#[test]
fn a_joint_without_weight_does_not_count_and_one_of_weight_two_counts_twice() {
    let loss = |weights: Option<Vec<f64>>, batch: &Series| {
        let spec = TrainSpec { loss_weights: weights, ..train_spec() };
        trainer(&spec).step(batch).unwrap().loss
    };
    let usual = batch(0, 8);
    let (plain, twice) = (loss(None, &usual), loss(Some(vec![2.0; 7]), &usual));
    assert!((twice - 2.0 * plain).abs() < 1e-6 * plain, "{plain} {twice}");

    let mut other_joint_3 = usual.clone();
    for y in other_joint_3.y_mut().chunks_exact_mut(usual.shape().values_per_robot()) {
        y[CONTEXT as usize * 7..].iter_mut().skip(2).step_by(7).for_each(|value| *value += 1.0);
    }
    let without = || Some(vec![1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(loss(without(), &usual), loss(without(), &other_joint_3));
    assert_ne!(loss(None, &usual), loss(None, &other_joint_3));
}

#[test]
fn batches_of_the_wrong_shape_or_with_nan_are_refused() {
    let mut trainer = trainer(&train_spec());
    let mut refused = |batch: &Series| trainer.step(batch).unwrap_err().to_string();
    let zeros = |robots, samples, joints| {
        let values = robots * samples * joints;
        let shape = Shape { robots, samples, joints };
        Series::new(shape, 60.0, vec![0.0; values], vec![0.0; values]).unwrap()
    };
    let error = refused(&zeros(2, 25, 7));
    assert_eq!(error, "the model was given 25 samples of u, expected 24");
    assert_eq!(refused(&zeros(2, 24, 6)), "the model was given 6 joints, expected 7");
    assert_eq!(refused(&zeros(0, 24, 7)), "the model was given 0 trajectories, expected 1");
    let shape = Shape { robots: 2, samples: 24, joints: 7 };
    let question = Series::question(shape, 16, 60.0, vec![0.0; 336], vec![0.0; 224]).unwrap();
    let error = refused(&question);
    assert_eq!(error, "the model was given 16 samples of y, expected 24");

    let mut poisoned = batch(0, 2);
    poisoned.y_mut()[200] = f32::NAN;
    assert!(matches!(
        trainer.step(&poisoned),
        Err(ModelError::NotFiniteInput { what: "y", trajectory: 1 })
    ));
}

#[test]
fn dataset_normalization_without_statistics_is_refused() {
    let spec = TrainSpec { normalization: Normalization::Dataset, ..train_spec() };
    let result = Trainer::new(&spec, DATA, "digest", &Device::cpu());
    assert!(matches!(result, Err(ModelError::MissingStatistics)));
}

/// Adam without memory of the gradients' size. A parameter whose gradient vanishes in one step can
/// then move by any distance.
fn explosive() -> TrainSpec {
    let mut spec = train_spec();
    spec.optimizer = OptimizerSpec {
        learning_rate: 1.0,
        betas: [0.99, 0.0],
        epsilon: 1e-12,
        ..OptimizerSpec::default()
    };
    spec
}

#[test]
fn a_training_that_explodes_says_so_and_leaves_no_number_that_is_not_finite() {
    let mut trainer = trainer(&explosive());
    let mut kept = trainer.checkpoint().unwrap();
    let error = (0..2000).find_map(|step| {
        let checkpoint = trainer.step(&batch(step, 8)).and_then(|_| trainer.checkpoint());
        checkpoint.map(|checkpoint| kept = checkpoint).err()
    });
    let error = error.unwrap();
    let is_named = match &error {
        ModelError::LossNotFinite { step, loss, learning_rate } => {
            *step == trainer.steps_done() + 1 && !loss.is_finite() && *learning_rate > 0.1
        }
        ModelError::GradientNotFinite { step, gradient_norm, .. } => {
            *step == trainer.steps_done() + 1 && !gradient_norm.is_finite()
        }
        ModelError::NotFiniteTensor { value, .. } => !value.is_finite(),
        _ => false,
    };
    assert!(is_named, "{error}");
    models::TrainedModel::from_files(&kept, &Device::cpu()).unwrap();
    Trainer::resume(&explosive(), DATA, "digest", &kept, &Device::cpu()).unwrap();
}

fn statistics() -> models::Statistics {
    let mut accumulator = StatisticsAccumulator::new(7);
    for index in 0..10 {
        let batch = batch(index, 8);
        accumulator.add(&batch.view());
    }
    accumulator.finish()
}
