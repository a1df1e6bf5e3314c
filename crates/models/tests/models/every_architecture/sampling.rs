//! Answers and samples: their random keys, warm starts, and refusals.

use models::{Device, ModelError, Sampling, TrainedModel, ValidationPart, WarmStart};
use spec::{EmaSpec, Lengths, SamplerKind, SamplerSpec, TrainSpec};

use super::{
    CONTEXT, CONTEXT_VALUES, HORIZON_VALUES, ROW, SAMPLES, briefly_trained, known, train, trainer,
};
use crate::synthetic::{JOINTS, batch, every_kind, kind, training_of};

fn generative_kinds() -> impl Iterator<Item = (String, TrainedModel)> {
    every_kind()
        .into_iter()
        .map(|(name, model)| (name, briefly_trained(model)))
        .filter(|(_, model)| model.is_generative())
}

fn kinds_with_samplers() -> impl Iterator<Item = (String, TrainedModel)> {
    generative_kinds().filter(|(_, model)| model.architecture().sampler().is_some())
}

#[test]
fn a_model_predicts_what_its_trainer_validated() {
    for (name, model) in every_kind() {
        for ema in [None, Some(EmaSpec { decay: 0.5, power: 1.0 })] {
            let mut trainer = trainer(&TrainSpec { ema, ..training_of(model.clone()) });
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

/// A planner asks only for the part of the horizon that it needs.
#[test]
fn the_least_horizon_is_answered_and_no_longer_than_it_has_to_be() {
    let batch = batch(53, 3);
    let view = batch.view();
    for (name, model) in every_kind() {
        let expected = match model.lengths() {
            Lengths::Trained => [8, 8, 8],
            Lengths::From(_) => [4, 8, 8],
            Lengths::Any => [1, 5, 8],
        };
        let model = briefly_trained(model);
        let whole = model.predict(&known(&batch)).unwrap();
        for (steps, expected) in [1, 5, 8].into_iter().zip(expected) {
            let horizon = model.horizon_of(steps);
            assert_eq!(horizon, expected, "{name}");
            let samples = CONTEXT as usize + horizon;
            let question = view.window(0..samples);
            let answer = model.predict(&question.observed(0, CONTEXT as usize)).unwrap();
            assert_eq!(answer.len(), 3 * horizon * JOINTS, "{name}");
            if horizon == steps {
                let mut each = answer.chunks(horizon * JOINTS).zip(whole.chunks(HORIZON_VALUES));
                let same = each.all(|(found, whole)| *found == whole[..steps * JOINTS]);
                assert!(same, "{name}");
            }
        }
    }
}

#[test]
fn a_model_answers_its_own_lengths_those_it_was_cut_to_or_any() {
    let batch = batch(53, 3);
    let view = batch.view();
    // Context and samples.
    let questions = [(16, 24), (8, 24), (12, 16), (4, 24), (10, 24), (16, 22), (2, 24)];
    let answered = |model: &TrainedModel, (context, samples)| {
        let answer = model.predict(&view.window(0..samples).observed(0, context));
        let complete = |answer: &Vec<f32>| answer.len() == 3 * (samples - context) * JOINTS;
        answer.is_ok_and(|answer| complete(&answer) && answer.iter().all(|value| value.is_finite()))
    };
    for (name, model) in every_kind() {
        let expected = match model.lengths() {
            Lengths::Trained => [true, false, false, false, false, false, false],
            Lengths::From(_) => [true, true, true, false, false, false, false],
            Lengths::Any => [true, true, true, true, true, true, false],
        };
        let model = briefly_trained(model);
        assert_eq!(questions.map(|question| answered(&model, question)), expected, "{name}");
    }
}

#[test]
fn a_checkpoint_with_a_least_context_beyond_its_context_is_refused() {
    let trainer = trainer(&training_of(kind("prefix-transformer, many lengths")));
    let mut files = trainer.checkpoint().unwrap();
    let mut config: serde_json::Value = serde_json::from_slice(&files.config).unwrap();
    for least in [CONTEXT + 4, 6, 0] {
        config["model"]["least_context"] = least.into();
        files.config = serde_json::to_vec(&config).unwrap();
        let error = TrainedModel::from_files(&files, &Device::cpu()).unwrap_err();
        assert!(error.to_string().contains("least_context"), "{error}");
    }
}

#[test]
fn a_model_without_lengths_answers_the_beginning_of_a_longer_question() {
    let batch = batch(53, 3);
    let shorter = CONTEXT as usize + 2;
    let few = CONTEXT_VALUES / 2 / JOINTS;
    for (name, model) in every_kind() {
        if model.lengths() != Lengths::Any {
            continue;
        }
        let model = briefly_trained(model);
        let cut = batch.view().window(0..shorter);
        let late = batch.view().window(CONTEXT as usize - few..SAMPLES as usize);
        let questions = [cut.observed(0, CONTEXT as usize), late.observed(0, few)];
        let whole = model.predict(&known(&batch)).unwrap();
        let [cut, late] = questions.map(|question| model.predict(&question).unwrap());
        for (cut, whole) in cut.chunks(2 * JOINTS).zip(whole.chunks(HORIZON_VALUES)) {
            assert_eq!(*cut, whole[..2 * JOINTS], "{name}");
        }
        assert_eq!(late.len(), whole.len(), "{name}");
        assert!(late != whole, "{name}");
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
    for (name, model) in kinds_with_samplers() {
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

/// One step from level 0, which has almost no noise, cannot move far from its start. From pure
/// noise it ends elsewhere.
#[test]
fn a_warm_start_stays_near_the_previous_prediction() {
    let batch = batch(62, 2);
    let question = known(&batch);
    let previous: Vec<f32> =
        batch.y().chunks_exact(ROW).flat_map(|y| &y[CONTEXT_VALUES..]).copied().collect();
    let warm_start = |steps| WarmStart { previous: previous.clone(), shift: 0, steps };
    for (name, model) in kinds_with_samplers() {
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
    let point = briefly_trained(kind("robomorph"));
    let error = point.sample(&question, &Sampling::default()).unwrap_err();
    assert!(matches!(error, ModelError::NotGenerative), "{error}");

    let gaussian = briefly_trained(kind("robomorph, gaussian"));
    let sampler = Some(SamplerSpec::default());
    let error =
        gaussian.sample(&question, &Sampling { sampler, ..Sampling::default() }).unwrap_err();
    assert!(error.to_string().contains("sampler is given"), "{error}");

    let diffuser = briefly_trained(kind("diffuser"));
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
    let error = refused(&briefly_trained(kind("flow")), SamplerKind::Ddpm);
    assert!(error.contains("sampler.kind is ddpm") && error.contains("euler, heun"), "{error}");
}
