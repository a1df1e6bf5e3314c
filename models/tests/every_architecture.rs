//! What every architecture promises, whatever it is made of.

#![expect(clippy::unwrap_used, reason = "a test ends at what it did not expect")]

mod synthetic;

use models::{
    Device, ModelError, Sampling, TrainedModel, Trainer, TrainingData, ValidationPart,
    ValidationReport, WarmStart,
};
use serde_json::json;
use series::{Observed, Series, Shape};
use spec::{
    CdtSpec, EmaSpec, Known, ModelSpec, Normalization, SamplerKind, SamplerSpec, TrainSpec,
};
use synthetic::{CONTEXT, DATA, SAMPLES, batch, every_kind, train_spec};

/// Joints of the Panda.
const JOINTS: usize = 7;

const CONTEXT_VALUES: usize = CONTEXT as usize * JOINTS;
const HORIZON_VALUES: usize = (SAMPLES - CONTEXT) as usize * JOINTS;
const ROW: usize = SAMPLES as usize * JOINTS;

#[test]
fn every_architecture_is_tested() {
    let kinds = every_kind();
    for architecture in ModelSpec::ARCHITECTURES {
        assert!(
            kinds.iter().any(|(_, model)| model.architecture() == *architecture),
            "{architecture} is not among the kinds of `synthetic::every_kind`"
        );
    }
}

fn trainer(spec: &TrainSpec) -> Trainer {
    Trainer::new(spec, DATA, "digest", &Device::cpu()).unwrap()
}

fn train(trainer: &mut Trainer, steps: std::ops::Range<u64>) {
    for step in steps {
        trainer.step(&batch(step, 8)).unwrap();
    }
}

fn known(batch: &Series) -> Observed<'_> {
    batch.observed(CONTEXT as usize)
}

fn briefly_trained(model: ModelSpec) -> TrainedModel {
    let mut trainer = trainer(&TrainSpec { model, ..train_spec() });
    train(&mut trainer, 0..3);
    TrainedModel::from_files(&trainer.checkpoint().unwrap(), &Device::cpu()).unwrap()
}

fn generative_kinds() -> impl Iterator<Item = (&'static str, TrainedModel)> {
    every_kind()
        .into_iter()
        .map(|(name, model)| (name, briefly_trained(model)))
        .filter(|(_, model)| model.is_generative())
}

/// As `ValidationReport::rmse_rad`, of the last known position held.
fn hold_last_rmse(batch: &Series) -> f64 {
    let mut total = 0.0;
    for y in batch.y().chunks_exact(ROW) {
        let (context, horizon) = y.split_at(CONTEXT_VALUES);
        let last = &context[CONTEXT_VALUES - JOINTS..];
        for (joint, last) in last.iter().enumerate() {
            let errors = horizon.iter().skip(joint).step_by(JOINTS);
            let squares: f32 = errors.map(|value| (value - last).powi(2)).sum();
            total += f64::from(squares / (HORIZON_VALUES / JOINTS) as f32).sqrt();
        }
    }
    total / (batch.robots() * JOINTS) as f64
}

/// A short training's validation error falls below `share` of that of holding the last position.
#[track_caller]
fn check_learning(kind: &str, share: f64) {
    let held_out = batch(1_000_000, 32);
    let hold_last = hold_last_rmse(&held_out);
    let (_, model) = every_kind().into_iter().find(|(name, _)| *name == kind).unwrap();
    let mut spec = TrainSpec { model, steps: 600, ..train_spec() };
    spec.optimizer.learning_rate = 5e-3;
    let mut trainer = trainer(&spec);
    train(&mut trainer, 0..600);
    let report = trainer.validate(&ValidationPart::whole(&held_out)).unwrap();
    println!("{kind}: {:.4} rad, held {hold_last:.4} rad", report.rmse_rad());
    assert!(report.rmse_rad() < share * hold_last, "{kind}: {report:?}, hold-last {hold_last}");
}

#[test]
fn robomorph_learns() {
    check_learning("robomorph", 0.6);
}

#[test]
fn robomorph_with_a_gaussian_head_learns() {
    check_learning("robomorph, gaussian", 0.6);
}

#[test]
fn robomorph_learns_what_the_integrator_leaves_over() {
    check_learning("robomorph, residual", 0.6);
}

#[test]
fn diffuser_learns() {
    check_learning("diffuser", 0.6);
}

#[test]
fn diffuser_with_joint_noise_learns() {
    // Slower to learn: u is noise to it as well.
    check_learning("diffuser, joint noise", 1.0);
}

#[test]
fn cdcnn_learns() {
    check_learning("cdcnn", 0.6);
}

#[test]
fn cdcnn_with_global_conditioning_learns() {
    check_learning("cdcnn, global", 0.6);
}

#[test]
fn cdt_learns() {
    check_learning("cdt", 0.6);
}

#[test]
fn flow_learns() {
    check_learning("flow", 0.6);
}

#[test]
fn flow_that_answers_velocities_learns() {
    check_learning("flow, velocity", 0.6);
}

/// Torques and positions of an arm with one joint less than the others here.
fn six_joints(robots: usize) -> Series {
    let shape = Shape { robots, samples: SAMPLES as usize, joints: 6 };
    let values = shape.values().unwrap();
    let wave = |rate: f32| (0..values).map(|k| (rate * k as f32).sin()).collect();
    Series::new(shape, DATA.rate_hz, wave(0.37), wave(0.11)).unwrap()
}

#[test]
fn an_arm_of_six_joints_is_trained_kept_and_predicted() {
    let (batch, seven) = (six_joints(8), batch(0, 8));
    for (name, model) in every_kind() {
        let data = || TrainingData { joints: 6, ..DATA };
        let spec = TrainSpec { model, ..train_spec() };
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

        // A Panda's checkpoints say what they always said.
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
            let spec =
                TrainSpec { model: model.clone(), ema, gradient_accumulation, ..train_spec() };
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
                let spec = TrainSpec { model: model.clone(), ..train_spec() };
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
fn what_is_left_out_is_left_out_in_training_alone_and_of_each_trajectory_apart() {
    let (_, model) = every_kind().into_iter().find(|(name, _)| *name == "cdt").unwrap();
    let ModelSpec::Cdt(without) = model else { panic!("cdt is a CDT") };
    let report = |dropout: f64, embedding_dropout: f64| {
        let model = ModelSpec::Cdt(CdtSpec { dropout, embedding_dropout, ..without.clone() });
        let mut trainer = trainer(&TrainSpec { model, ..train_spec() });
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
fn a_validation_is_the_same_in_any_parts() {
    for (name, model) in every_kind() {
        let trainer = trainer(&TrainSpec { model, ..train_spec() });
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
        let in_one_pass = model.sampler().is_none();
        let trainer = trainer(&TrainSpec { model, ..train_spec() });
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

#[test]
fn a_model_predicts_what_its_trainer_validated() {
    for (name, model) in every_kind() {
        for ema in [None, Some(EmaSpec { decay: 0.5, power: 1.0 })] {
            let mut trainer = trainer(&TrainSpec { model: model.clone(), ema, ..train_spec() });
            train(&mut trainer, 0..3);
            let files = trainer.checkpoint().unwrap();
            let model = TrainedModel::from_files(&files, &Device::cpu()).unwrap();
            let batch = batch(50, 5);
            let predicted = model.predict(&known(&batch)).unwrap();
            let mut total = 0.0;
            for (predicted, truth) in predicted.chunks(HORIZON_VALUES).zip(batch.y().chunks(ROW)) {
                for joint in 0..JOINTS {
                    let pairs = predicted.iter().zip(&truth[CONTEXT_VALUES..]);
                    let squares: f64 = pairs
                        .skip(joint)
                        .step_by(JOINTS)
                        .map(|(a, b)| f64::from(a - b).powi(2))
                        .sum();
                    total += (squares / (HORIZON_VALUES / JOINTS) as f64).sqrt();
                }
            }
            let rmse = total / (5 * JOINTS) as f64;
            let reported = trainer.validate(&ValidationPart::whole(&batch)).unwrap().rmse_rad();
            assert!((rmse - reported).abs() < 1e-6 * reported, "{name}: {rmse} {reported}");
        }
    }
}

#[test]
fn gradients_of_parts_of_a_batch_add_up_to_those_of_the_whole() {
    for (name, model) in every_kind() {
        let report = |parts| {
            let spec =
                TrainSpec { model: model.clone(), gradient_accumulation: parts, ..train_spec() };
            trainer(&spec).step(&batch(0, 8)).unwrap()
        };
        let (whole, parts) = (report(1), report(4));
        let close = |a: f64, b: f64| (a - b).abs() < 1e-4 * b.abs();
        assert!(close(parts.loss, whole.loss), "{name}: {parts:?} {whole:?}");
        assert!(close(parts.gradient_norm, whole.gradient_norm), "{name}: {parts:?} {whole:?}");
    }
}

#[test]
fn no_answer_depends_on_the_positions_of_the_horizon() {
    let batch = batch(53, 3);
    let mut other = batch.clone();
    for y in other.y_mut().chunks_exact_mut(ROW) {
        for value in &mut y[CONTEXT_VALUES..] {
            *value = 100.0 - *value;
        }
    }
    for (name, model) in every_kind() {
        let model = briefly_trained(model);
        let answer = model.predict_with_leak(&batch.view()).unwrap();
        assert_eq!(answer, model.predict_with_leak(&other.view()).unwrap(), "{name}");
        assert_eq!(answer, model.predict(&known(&batch)).unwrap(), "{name}");
        assert!(answer.iter().all(|value| value.is_finite()), "{name}");
    }
}

#[test]
fn a_sample_is_the_same_whatever_it_is_asked_together_with() {
    let batch = batch(60, 5);
    let question = known(&batch);
    for (name, model) in generative_kinds() {
        let all = Sampling { samples: 30, seed: 4, ..Sampling::default() };
        let many = model.sample(&question, &all).unwrap();
        assert_eq!(many.len(), 30 * 5 * HORIZON_VALUES);
        let alone = question.pick(&[3]);
        let one = Sampling { samples: 2, first_scenario: 3, ..all };
        let few = model.sample(&alone, &one).unwrap();
        for sample in 0..2 {
            let among = &many[(sample * 5 + 3) * HORIZON_VALUES..][..HORIZON_VALUES];
            let alone = &few[sample * HORIZON_VALUES..][..HORIZON_VALUES];
            let largest = among.iter().zip(alone).fold(0.0, |a: f32, (b, c)| a.max((b - c).abs()));
            assert!(largest < 1e-4, "{name}: {largest}");
        }
        assert_ne!(few[..HORIZON_VALUES], few[HORIZON_VALUES..], "{name} has one answer only");
    }
}

#[test]
fn every_sampler_gives_finite_positions() {
    let batch = batch(61, 2);
    let question = known(&batch);
    for (name, model) in
        generative_kinds().filter(|(_, model)| model.architecture().sampler().is_some())
    {
        for &kind in model.architecture().generation().unwrap().samplers() {
            for steps in [Some(1), Some(7), None] {
                let sampler = Some(SamplerSpec { kind, steps, ..SamplerSpec::default() });
                let sampling = Sampling { sampler, ..Sampling::default() };
                let answer = model.sample(&question, &sampling).unwrap();
                let finite = answer.iter().all(|value| value.is_finite());
                assert!(finite, "{name}, {kind:?}, {steps:?} steps");
            }
        }
    }
}

/// One step from level 0, at which there is next to no noise, cannot move far from where it began;
/// from pure noise it lands elsewhere.
#[test]
fn a_warm_start_stays_near_the_previous_prediction() {
    let batch = batch(62, 2);
    let question = known(&batch);
    let previous: Vec<f32> =
        batch.y().chunks_exact(ROW).flat_map(|y| &y[CONTEXT_VALUES..]).copied().collect();
    let warm_start = |steps| WarmStart { previous: previous.clone(), shift: 0, steps };
    for (name, model) in
        generative_kinds().filter(|(_, model)| model.architecture().sampler().is_some())
    {
        let from = |warm_start| {
            let sampling = Sampling { warm_start, ..Sampling::default() };
            model.sample(&question, &sampling).unwrap()
        };
        let distance = |answer: &[f32]| {
            let squares = answer.iter().zip(&previous).map(|(a, b)| (a - b).powi(2));
            (squares.sum::<f32>() / previous.len() as f32).sqrt()
        };
        let (warm, cold) = (from(Some(warm_start(1))), from(None));
        assert!(warm != cold, "{name}");
        assert!(distance(&warm).is_finite() && distance(&cold).is_finite(), "{name}");

        let error = model
            .sample(
                &question,
                &Sampling { warm_start: Some(warm_start(21)), ..Sampling::default() },
            )
            .unwrap_err();
        assert!(error.to_string().contains("warm_start.steps is 21"), "{error}");
        let short = WarmStart { previous: vec![0.0; 3], shift: 1, steps: 1 };
        let error = model
            .sample(&question, &Sampling { warm_start: Some(short), ..Sampling::default() })
            .unwrap_err();
        assert!(matches!(error, ModelError::Length { .. }), "{error}");
    }
}

#[test]
fn what_a_model_cannot_do_is_refused_by_name() {
    let batch = batch(63, 1);
    let question = known(&batch);
    let kinds = every_kind();
    let point = briefly_trained(kinds[0].1.clone());
    let error = point.sample(&question, &Sampling::default()).unwrap_err();
    assert!(matches!(error, ModelError::NotGenerative), "{error}");

    let gaussian = briefly_trained(kinds[1].1.clone());
    let sampler = Some(SamplerSpec::default());
    let error =
        gaussian.sample(&question, &Sampling { sampler, ..Sampling::default() }).unwrap_err();
    assert!(error.to_string().contains("sampler is given"), "{error}");

    let diffuser = briefly_trained(kinds[3].1.clone());
    let sampler = Some(SamplerSpec { steps: Some(21), ..SamplerSpec::default() });
    let error =
        diffuser.sample(&question, &Sampling { sampler, ..Sampling::default() }).unwrap_err();
    assert!(error.to_string().contains("sampler.steps is 21"), "{error}");
    assert!(error.to_string().contains("diffusion.steps, which is 20"), "{error}");

    let refused = |model: &TrainedModel, kind| {
        let sampler = Some(SamplerSpec { kind, ..SamplerSpec::default() });
        let sampling = Sampling { sampler, ..Sampling::default() };
        model.sample(&question, &sampling).unwrap_err().to_string()
    };
    let error = refused(&diffuser, SamplerKind::Euler);
    assert!(error.contains("sampler.kind is euler") && error.contains("dpm-solver++"), "{error}");
    let (_, flow) = kinds.iter().find(|(name, _)| *name == "flow").unwrap();
    let error = refused(&briefly_trained(flow.clone()), SamplerKind::Ddpm);
    assert!(error.contains("sampler.kind is ddpm") && error.contains("euler, heun"), "{error}");
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
fn a_residual_of_the_exact_integrator_starts_at_its_prediction() {
    // Untrained weights predict small multiples of the residual's scale, which is near zero here.
    let mut exact = batch(64, 4);
    let (u, y) = exact.both_mut();
    for (u, y) in u.chunks_exact(ROW).zip(y.chunks_exact_mut(ROW)) {
        for i in JOINTS..ROW {
            y[i] = y[i - JOINTS] + u[i - JOINTS] / 10.0 / 60.0;
        }
    }
    for (name, model) in every_kind() {
        let mut spec = serde_json::to_value(model).unwrap();
        spec["residual"] = json!("integrator");
        let model = briefly_trained(serde_json::from_value(spec).unwrap());
        let answer = model.predict(&known(&exact)).unwrap();
        for (answer, truth) in answer.chunks(HORIZON_VALUES).zip(exact.y().chunks(ROW)) {
            for (a, b) in answer.iter().zip(&truth[CONTEXT_VALUES..]) {
                assert!((a - b).abs() < 0.02, "{name}: {a} {b}");
            }
        }
    }
}

#[test]
fn all_normalizations_train_every_architecture() {
    for (name, model) in every_kind() {
        let spec = TrainSpec { model, normalization: Normalization::PaperLeaky, ..train_spec() };
        let report = trainer(&spec).step(&batch(0, 8)).unwrap();
        assert!(report.loss.is_finite(), "{name}");
    }
}

#[test]
fn readings_of_the_papers_weights_differ_as_they_should() {
    let (_, model) = every_kind().swap_remove(3);
    let ModelSpec::Diffuser(diffuser) = model else { panic!("not a diffuser") };
    let loss = |known, weights| {
        let model = ModelSpec::Diffuser(spec::DiffuserSpec { known, weights, ..diffuser.clone() });
        trainer(&TrainSpec { model, ..train_spec() }).step(&batch(0, 8)).unwrap().loss
    };
    // Known u has no errors, whatever their weight; y's weight is a scale.
    let masked = loss(Known::CleanAndMasked, [1.0, 3.0]);
    assert_eq!(masked, loss(Known::CleanAndMasked, [100.0, 3.0]));
    assert!((loss(Known::CleanAndMasked, [1.0, 1.0]) * 3.0 - masked).abs() < 1e-5 * masked);
    // With noise on both, both weights count.
    let joint = loss(Known::JointNoise, [1.0, 3.0]);
    assert_ne!(joint, loss(Known::JointNoise, [2.0, 3.0]));
    assert_ne!(joint, loss(Known::JointNoise, [1.0, 4.0]));
}
