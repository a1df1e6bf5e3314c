use evaluation::{EvaluationError, Learned, Predictor, Start};
use models::Sampling;
use serde_json::json;

use super::{CONTEXT, SAMPLES, bits, every_kind, scenarios, simulation, trained};

#[test]
fn a_receding_horizon_goes_on_from_its_own_prediction() {
    let (_, cdcnn) = every_kind().remove(4);
    let model = trained(&cdcnn, "context");
    let predictor = |start| Learned {
        name: "cdcnn".to_owned(),
        model: &model,
        sampling: Sampling::default(),
        start,
    };
    let recording = scenarios(&simulation(SAMPLES + 3, &json!({})), 2, 3);
    let observed = recording.observed(CONTEXT);
    let shifted = Start::Shifted { shift: 1, steps: 2 };
    let receding = predictor(shifted).predict(&observed).unwrap();

    // By hand: from noise three samples ago, then twice from the prediction before.
    let mut before = predictor(Start::Cold).predict(&observed.earlier(3).unwrap()).unwrap();
    for back in [2, 1, 0] {
        let previous = std::mem::take(&mut before);
        let warm_start = Some(models::WarmStart { previous, shift: 1, steps: 2 });
        let window = observed.earlier(back).unwrap();
        let input = models::PredictionInput { u: window.u, y_context: window.y, size: 2 };
        before = model.sample(&input, &Sampling { warm_start, ..Sampling::default() }).unwrap();
    }
    assert_eq!(bits(&receding), bits(&before));
}

#[test]
fn a_receding_horizon_without_a_past_is_an_error_that_says_so() {
    let (_, cdcnn) = every_kind().remove(4);
    let model = trained(&cdcnn, "context");
    let recording = scenarios(&simulation(SAMPLES + 1, &json!({})), 2, 1);
    for shift in [0, 2] {
        let start = Start::Shifted { shift, steps: 2 };
        let (name, sampling) = ("cdcnn".to_owned(), Sampling::default());
        let predictor = Learned { name, model: &model, sampling, start };
        let error = predictor.predict(&recording.observed(CONTEXT)).unwrap_err();
        assert!(matches!(error, EvaluationError::PreRoll { pre_roll: 1, .. }), "{error}");
    }
}

#[test]
fn only_models_with_several_answers_have_samples() {
    let recording = scenarios(&simulation(SAMPLES, &json!({})), 2, 0);
    for (name, model) in every_kind() {
        let model = trained(&model, "context");
        let predictor = Learned {
            name: name.to_owned(),
            model: &model,
            sampling: Sampling::default(),
            start: Start::Cold,
        };
        let samples = predictor.sample(&recording.observed(CONTEXT), 4).unwrap();
        assert_eq!(samples.is_some(), model.is_generative(), "{name}");
        if let Some(samples) = samples {
            assert_eq!(samples.count, 4);
            assert_eq!(samples.positions.len(), 4 * 2 * (SAMPLES - CONTEXT) * spec::JOINTS);
        }
    }
}
