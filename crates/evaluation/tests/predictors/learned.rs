use evaluation::{EvaluationError, Learned, Predictor, Start};
use models::{Interrupt, ModelError, Sampling};
use serde_json::json;

use super::{CONTEXT, SAMPLES, bits, scenarios, simulation, smallest, trained};

use crate::JOINTS;

#[test]
fn a_receding_horizon_goes_on_from_its_own_prediction() {
    let model = trained(&smallest::model("cdcnn"));
    let predictor = |start| Learned {
        name: "cdcnn".to_owned(),
        model: &model,
        sampling: Sampling::default(),
        start,
        first: None,
    };
    let recording = scenarios(&simulation(SAMPLES + 3, &json!({})), 2);
    let observed = recording.view().observed(3, CONTEXT);
    let shifted = Start::Shifted { shift: 1, steps: 2 };
    let receding = predictor(shifted).predict(&observed).unwrap();

    // Computed by hand: from noise three samples ago, then from the prediction before, each with
    // other noise.
    let mut warm_start = None;
    let mut before = Vec::new();
    for back in [3, 2, 1, 0] {
        let window = observed.earlier(back).unwrap();
        let sampling = Sampling { warm_start, seed: (back as u64) << 53, ..Sampling::default() };
        before = model.sample(&window, &sampling).unwrap();
        warm_start = Some(models::WarmStart { previous: before.clone(), shift: 1, steps: 2 });
    }
    assert_eq!(bits(&receding), bits(&before));

    // Several samples continue the same past, and the prediction is the first of them.
    let first = evaluation::FirstPrediction::new();
    for _ in 0..2 {
        let sharing = Learned { first: Some(&first), ..predictor(shifted) };
        let answer = sharing.answer(&observed, 3).unwrap();
        assert_eq!(bits(&answer.positions), bits(&receding));
        assert_eq!(bits(&answer.samples.unwrap().positions[..receding.len()]), bits(&receding));
    }
}

#[test]
fn a_receding_horizon_without_a_past_is_an_error_that_says_so() {
    let model = trained(&smallest::model("cdcnn"));
    let recording = scenarios(&simulation(SAMPLES + 1, &json!({})), 2);
    for shift in [0, 2] {
        let start = Start::Shifted { shift, steps: 2 };
        let (name, sampling) = ("cdcnn".to_owned(), Sampling::default());
        let predictor = Learned { name, model: &model, sampling, start, first: None };
        let observed = recording.view().observed(1, CONTEXT);
        let error = predictor.predict(&observed).unwrap_err();
        assert!(matches!(error, EvaluationError::PreRoll { pre_roll: 1, .. }), "{error}");
    }
}

#[test]
fn only_models_with_several_answers_have_samples() {
    let recording = scenarios(&simulation(SAMPLES, &json!({})), 2);
    for (name, model) in smallest::models() {
        let model = trained(&model);
        let predictor = Learned {
            name: name.clone(),
            model: &model,
            sampling: Sampling::default(),
            start: Start::Cold,
            first: None,
        };
        let samples = predictor.answer(&recording.observed(CONTEXT), 4).unwrap().samples;
        assert_eq!(samples.is_some(), model.is_generative(), "{name}");
        if let Some(samples) = samples {
            assert_eq!(samples.count, 4);
            assert_eq!(samples.positions.len(), 4 * 2 * (SAMPLES - CONTEXT) * JOINTS);
        }
    }
}

#[test]
fn every_model_ends_when_it_is_interrupted() {
    let recorded = scenarios(&simulation(SAMPLES, &json!({})), 2);
    for (name, model) in smallest::models() {
        let model = trained(&model);
        let answer = || model.predict(&recorded.observed(CONTEXT));
        let interrupt = Interrupt::default();
        assert!(interrupt.guard(answer).is_ok(), "{name}");
        interrupt.raise();
        assert!(matches!(interrupt.guard(answer), Err(ModelError::Interrupted)), "{name}");
    }
}
