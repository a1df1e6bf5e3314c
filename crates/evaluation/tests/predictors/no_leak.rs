//! Predictions do not depend on the positions of the horizon.

use evaluation::{LeakyLearned, Learned, OracleStarted, Predictor, Start, baseline};
use models::{Sampling, TrainedModel};
use serde_json::json;
use series::Series;
use spec::{Baseline, SamplerKind, SamplerSpec};

use super::{
    CONTEXT, SAMPLES, STEPS, arm, bits, scenarios, simulation, smallest, trained, trained_with,
    with_horizon,
};

/// Two recordings with other positions in the horizon: noise, and NaN.
fn others(scenarios: &Series, known: usize) -> [Series; 2] {
    [
        with_horizon(scenarios, known, |k| (12.9898 * k as f32).sin()),
        with_horizon(scenarios, known, |_| f32::NAN),
    ]
}

/// Whether prediction and samples are the same bits whatever the horizon is.
fn is_blind(
    predictor: &dyn Predictor,
    scenarios: &Series,
    [pre_roll, context]: [usize; 2],
) -> bool {
    let answers = |scenarios: &Series| {
        let observed = scenarios.view().observed(pre_roll, context);
        let predicted = predictor.predict(&observed).unwrap();
        assert!(predicted.iter().all(|value| value.is_finite()), "{}", predictor.name());
        let samples = predictor.answer(&observed, 3).unwrap().samples;
        (bits(&predicted), samples.map(|samples| bits(&samples.positions)))
    };
    let plain = answers(scenarios);
    others(scenarios, pre_roll + context).iter().all(|other| answers(other) == plain)
}

#[test]
fn noise_in_the_horizon_changes_no_bit_of_any_baseline() {
    let spec = simulation(140, &json!({}));
    let scenarios = scenarios(&spec, 3);
    for pre_roll in [0, 10] {
        for name in Baseline::all() {
            let predictor = baseline(name, &arm(&spec));
            assert!(is_blind(&*predictor, &scenarios, [pre_roll, 110]), "{}", predictor.name());
        }
    }
}

/// Filters see and smooth only the measurements of the context.
#[test]
fn neither_the_horizon_nor_the_truth_changes_a_bit_of_what_is_filtered() {
    let noise = json!({"observations": {"position_noise_rad": 1e-3, "torque_noise_nm": 0.05}});
    let recorded = scenarios(&simulation(140, &noise), 3);
    for name in Baseline::all() {
        let predictor = baseline(name, &arm(&simulation(140, &noise)));
        assert!(is_blind(&*predictor, &recorded, [10, 110]), "{}", predictor.name());
        assert!(is_blind_to_truth(&*predictor, &recorded, 110), "{}", predictor.name());
    }
    let recorded = scenarios(&simulation(SAMPLES + 4, &noise), 3);
    for (name, model) in smallest::models() {
        let model = trained(&model);
        let cold = learned(&name, &model, SamplerKind::Ddim, Start::Cold);
        let cold = Learned { sampling: Sampling::default(), ..cold };
        assert!(is_blind(&cold, &recorded, [4, CONTEXT]), "{}", cold.name);
        assert!(is_blind_to_truth(&cold, &recorded.copy(0..2), CONTEXT), "{}", cold.name);
    }
}

/// Whether a prediction stays the same when the true positions behind the measured ones change.
fn is_blind_to_truth(predictor: &dyn Predictor, recorded: &Series, context: usize) -> bool {
    let nowhere = vec![f32::NAN; recorded.y().len()];
    let mut other =
        Series::new(recorded.shape(), recorded.rate_hz(), nowhere.clone(), nowhere).unwrap();
    let (u, y) = other.add_noise(recorded.noise());
    u.copy_from_slice(recorded.u());
    y.copy_from_slice(recorded.y());
    assert!(other.true_y()[0].is_nan());
    let pre_roll = recorded.samples() - if context == CONTEXT { SAMPLES } else { 140 };
    let answer = |series: &Series| {
        bits(&predictor.predict(&series.view().observed(pre_roll, context)).unwrap())
    };
    answer(recorded) == answer(&other)
}

fn learned<'a>(
    name: &str,
    model: &'a TrainedModel,
    kind: SamplerKind,
    start: Start,
) -> Learned<'a> {
    let sampler = model.architecture().sampler().map(|_| SamplerSpec {
        kind,
        steps: Some(STEPS),
        ..SamplerSpec::default()
    });
    let sampling = Sampling { sampler, seed: 5, ..Sampling::default() };
    let name = format!("{name}, {kind:?}, {start:?}");
    Learned { name, model, sampling, start, first: None }
}

#[test]
fn noise_in_the_horizon_changes_no_bit_of_any_model_however_it_is_sampled() {
    let pre_roll = 4;
    let scenarios = scenarios(&simulation(SAMPLES + pre_roll, &json!({})), 3);
    for (name, model) in smallest::models() {
        let model = trained(&model);
        let generation = model.architecture().generation();
        let kinds = generation.map_or(&[SamplerKind::Ddpm][..], |generation| generation.samplers());
        for &kind in kinds {
            let cold = learned(&name, &model, kind, Start::Cold);
            assert!(is_blind(&cold, &scenarios, [pre_roll, CONTEXT]), "{}", cold.name);
        }
        if generation.is_some() {
            for shift in [1, 2] {
                let start = Start::Shifted { shift, steps: 2 };
                let shifted = learned(&name, &model, kinds[1], start);
                assert!(is_blind(&shifted, &scenarios, [pre_roll, CONTEXT]), "{}", shifted.name);
            }
        }
    }
}

/// Shows that the test above can fail.
#[test]
fn predictors_that_are_handed_the_horizon_are_found_out() {
    let scenarios = scenarios(&simulation(SAMPLES, &json!({})), 3);
    let noisy = with_horizon(&scenarios, CONTEXT, |k| (12.9898 * k as f32).sin());
    let observed = scenarios.observed(CONTEXT);
    let leaky =
        trained_with(&smallest::model("robomorph"), &json!({"normalization": "paper-leaky"}));
    let predict_leaky = |scenarios: &Series| {
        let scenarios = &scenarios.view();
        let predictor = LeakyLearned { name: "leaky".to_owned(), model: &leaky, scenarios };
        bits(&predictor.predict(&observed).unwrap())
    };
    assert_ne!(predict_leaky(&scenarios), predict_leaky(&noisy));

    let diffuser = trained(&smallest::model("diffuser"));
    let predict_oracle = |scenarios: &Series| {
        let scenarios = &scenarios.view();
        let (name, sampling) = ("oracle".to_owned(), Sampling::default());
        let predictor = OracleStarted { name, model: &diffuser, sampling, steps: 2, scenarios };
        bits(&predictor.predict(&observed).unwrap())
    };
    assert_ne!(predict_oracle(&scenarios), predict_oracle(&noisy));
}
