//! A training depends only on its spec and batches, and continues where it stopped.

use models::{Device, TrainedModel, Trainer, TrainingData, ValidationPart, ValidationReport};
use series::{Series, Shape};
use spec::{CdtSpec, EmaSpec, Known, ModelSpec, TrainSpec};

use super::{known, train, trainer};
use crate::synthetic::{CONTEXT, DATA, SAMPLES, batch, every_kind, kind, train_spec, training_of};

/// Torques and positions of an arm with one joint less than the other tests have.
fn six_joints(robots: usize) -> Series {
    let shape = Shape { robots, samples: SAMPLES as usize, joints: 6 };
    let values = shape.values().unwrap();
    let wave = |rate: f32| (0..values).map(|k| (rate * k as f32).sin()).collect();
    Series::new(shape, DATA.rate_hz, wave(0.37), wave(0.11)).unwrap()
}

#[test]
fn an_arm_of_six_joints_is_trained_kept_and_predicted() {
    let (batch, seven) = (six_joints(8), batch(0, 8));
    // A law that is told an arm has the joints of that arm.
    let kinds = every_kind().into_iter().filter(|(_, model)| model.robot().is_none());
    for (name, model) in kinds {
        let data = || TrainingData { joints: 6, ..DATA };
        let spec = training_of(model);
        let mut trained = Trainer::new(&spec, data(), "digest", &Device::cpu()).unwrap();
        trained.step(&batch).unwrap();
        let files = trained.checkpoint().unwrap();
        let mut resumed = Trainer::resume(&spec, data(), "digest", &files, &Device::cpu()).unwrap();
        assert!(resumed.checkpoint().unwrap() == files, "{name}");
        assert_eq!(resumed.step(&batch).unwrap(), trained.step(&batch).unwrap(), "{name}");
        assert!(Trainer::resume(&spec, DATA, "digest", &files, &Device::cpu()).is_err(), "{name}");

        let model = TrainedModel::from_files(&files, &Device::cpu()).unwrap();
        let answer = model.predict(&known(&batch)).unwrap();
        assert_eq!(answer.len(), 8 * (SAMPLES - CONTEXT) as usize * 6, "{name}");
        assert!(answer.iter().all(|value| value.is_finite()), "{name}");
        let error = model.predict(&known(&seven)).unwrap_err().to_string();
        assert_eq!(error, "the model was given 7 joints, expected 6");

        // Checkpoints of a Panda have no field for the joints, as before.
        let config = String::from_utf8(files.config).unwrap();
        assert!(config.contains("\"joints\": 6"), "{config}");
        let config = trainer(&spec).checkpoint().unwrap().config;
        assert!(!String::from_utf8(config).unwrap().contains("joints"), "{name}");
    }
}

#[test]
fn a_resumed_training_equals_an_uninterrupted_one_bit_for_bit() {
    for (name, model) in every_kind() {
        for (ema, gradient_accumulation) in [(None, 1), (Some(EmaSpec::default()), 4)] {
            let spec = TrainSpec { ema, gradient_accumulation, ..training_of(model.clone()) };
            let mut uninterrupted = trainer(&spec);
            train(&mut uninterrupted, 0..7);

            let mut interrupted = trainer(&spec);
            train(&mut interrupted, 0..3);
            let files = interrupted.checkpoint().unwrap();
            let mut resumed =
                Trainer::resume(&spec, DATA, "digest", &files, &Device::cpu()).unwrap();
            assert!(resumed.checkpoint().unwrap() == files, "{name} is not what was saved");
            train(&mut resumed, 3..7);

            let equal = resumed.checkpoint().unwrap() == uninterrupted.checkpoint().unwrap();
            assert!(equal, "{name}, {ema:?}");
        }
    }
}

#[test]
fn a_training_is_the_same_bit_for_bit_on_any_number_of_threads() {
    for (name, model) in every_kind() {
        let trained_on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let spec = training_of(model.clone());
                let mut trainer = trainer(&spec);
                for step in 0..3 {
                    trainer.step(&batch(step, 40)).unwrap();
                }
                let held_out = batch(99, 40);
                let report = trainer.validate(&ValidationPart::whole(&held_out)).unwrap();
                (trainer.checkpoint().unwrap(), report.loss(), report.rmse_rad())
            })
        };
        let alone = trained_on(1);
        for threads in [2, 5] {
            assert!(trained_on(threads) == alone, "{name}, {threads} threads");
        }
    }
}

#[test]
fn gradients_of_parts_of_a_batch_add_up_to_those_of_the_whole() {
    for (name, model) in every_kind() {
        let report = |parts| {
            let spec = TrainSpec { gradient_accumulation: parts, ..training_of(model.clone()) };
            trainer(&spec).step(&batch(0, 8)).unwrap()
        };
        let (whole, parts) = (report(1), report(4));
        let close = |a: f64, b: f64| (a - b).abs() < 1e-4 * b.abs();
        assert!(close(parts.loss, whole.loss), "{name}: {parts:?} {whole:?}");
        assert!(close(parts.gradient_norm, whole.gradient_norm), "{name}: {parts:?} {whole:?}");
    }
}

#[test]
fn what_is_left_out_is_left_out_in_training_alone_and_of_each_trajectory_apart() {
    let ModelSpec::Cdt(without) = kind("cdt") else { panic!("cdt is a CDT") };
    let report = |dropout: f64, embedding_dropout: f64| {
        let model = ModelSpec::Cdt(CdtSpec { dropout, embedding_dropout, ..without.clone() });
        let mut trainer = trainer(&training_of(model));
        let validated = trainer.validate(&ValidationPart::whole(&batch(9, 8))).unwrap();
        (trainer.step(&batch(0, 8)).unwrap().loss, validated.loss(), validated.rmse_rad())
    };
    let (loss, validation, rmse_rad) = report(0.0, 0.0);
    for (dropout, embedding_dropout) in [(0.2, 0.0), (0.0, 0.2)] {
        let with = report(dropout, embedding_dropout);
        assert_eq!((with.1, with.2), (validation, rmse_rad), "{dropout} {embedding_dropout}");
        assert!((with.0 - loss).abs() > 1e-4 * loss, "{dropout} {embedding_dropout}: {with:?}");
        assert_eq!(report(dropout, embedding_dropout), with);
    }
}

#[test]
fn readings_of_the_papers_weights_differ_as_they_should() {
    let ModelSpec::Diffuser(diffuser) = kind("diffuser") else { panic!("not a diffuser") };
    let loss = |known, weights| {
        let model = ModelSpec::Diffuser(spec::DiffuserSpec { known, weights, ..diffuser.clone() });
        trainer(&training_of(model)).step(&batch(0, 8)).unwrap().loss
    };
    // Known u has no errors, so its weight does not matter. y's weight is a scale.
    let masked = loss(Known::CleanAndMasked, [1.0, 3.0]);
    assert_eq!(masked, loss(Known::CleanAndMasked, [100.0, 3.0]));
    assert!((loss(Known::CleanAndMasked, [1.0, 1.0]) * 3.0 - masked).abs() < 1e-5 * masked);
    // With noise on both, both weights count.
    let joint = loss(Known::JointNoise, [1.0, 3.0]);
    assert_ne!(joint, loss(Known::JointNoise, [2.0, 3.0]));
    assert_ne!(joint, loss(Known::JointNoise, [1.0, 4.0]));
}

#[test]
fn averaged_weights_are_kept_apart_from_those_in_training() {
    let ema = Some(EmaSpec { decay: 0.9, power: 0.75 });
    let plain = train_spec();
    let averaged = TrainSpec { ema, ..train_spec() };
    let (mut without, mut with) = (trainer(&plain), trainer(&averaged));
    train(&mut without, 0..5);
    train(&mut with, 0..5);
    let (without, with) = (without.checkpoint().unwrap(), with.checkpoint().unwrap());
    assert_ne!(without.model, with.model, "the average is what is kept");
    let training = safetensors::SafeTensors::deserialize(&with.optimizer).unwrap();
    let kept = safetensors::SafeTensors::deserialize(&without.model).unwrap();
    for (name, view) in kept.iter() {
        let same = training.tensor(&format!("weights.{name}")).unwrap();
        assert_eq!(same.data(), view.data(), "{name}: an average must not change the training");
    }
}

#[test]
fn a_validation_is_the_same_in_any_parts() {
    for (name, model) in every_kind() {
        let trainer = trainer(&training_of(model));
        let all = batch(7, 12);
        let whole = trainer.validate(&ValidationPart::whole(&all)).unwrap();
        let mut parts = ValidationReport::default();
        for first in (0..12).step_by(5) {
            let batch = all.part(first..(first + 5).min(12));
            let predicted = batch.robots();
            parts += trainer.validate(&ValidationPart { batch, first, predicted }).unwrap();
        }
        let close = |a: f64, b: f64| (a - b).abs() < 1e-5 * b.abs();
        assert!(close(parts.loss(), whole.loss()), "{name}: {parts:?} {whole:?}");
        assert!(close(parts.rmse_rad(), whole.rmse_rad()), "{name}: {parts:?} {whole:?}");
    }
}

#[test]
fn a_denoiser_predicts_as_many_trajectories_as_it_is_asked_to() {
    for (name, model) in every_kind() {
        let in_one_pass = model.sampler().is_none() && model.architecture() != "lagrangian";
        let trainer = trainer(&training_of(model));
        let all = batch(7, 6);
        let part = ValidationPart { batch: all.view(), first: 0, predicted: 2 };
        let report = trainer.validate(&part).unwrap();
        let batch = all.part(0..if in_one_pass { 6 } else { 2 });
        let expected = ValidationPart { predicted: batch.robots(), batch, first: 0 };
        let expected = trainer.validate(&expected).unwrap().rmse_rad();
        assert!((report.rmse_rad() - expected).abs() < 1e-6 * expected, "{name}: {report:?}");
        let none = ValidationPart { predicted: 0, ..part };
        assert_eq!(trainer.validate(&none).unwrap().rmse_rad().is_nan(), !in_one_pass, "{name}");
    }
}
