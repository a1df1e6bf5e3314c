//! Answers of a trained model, and the data that they may depend on.

use models::{Device, ModelError, TrainedModel, Trainer, TrainingData};
use models::{Statistics, StatisticsAccumulator, ValidationPart};
use series::{Observed, Series, Shape};
use spec::{Normalization, TrainSpec};

use crate::synthetic::{CONTEXT, DATA, SAMPLES, batch, train_spec};

/// Joints of the Panda.
const JOINTS: usize = 7;

const CONTEXT_VALUES: usize = CONTEXT as usize * JOINTS;
const ROW: usize = SAMPLES as usize * JOINTS;

fn statistics() -> Statistics {
    let mut accumulator = StatisticsAccumulator::new(JOINTS);
    accumulator.add(&batch(5, 64).view());
    accumulator.finish()
}

fn trainer(normalization: Normalization) -> Trainer {
    let spec = TrainSpec { normalization, ..train_spec() };
    let data = TrainingData { statistics: Some(statistics()), ..DATA };
    let mut trainer = Trainer::new(&spec, data, "digest", &Device::cpu()).unwrap();
    for step in 0..3 {
        trainer.step(&batch(step, 8)).unwrap();
    }
    trainer
}

fn model(trainer: &Trainer) -> TrainedModel {
    TrainedModel::from_files(&trainer.checkpoint().unwrap(), &Device::cpu()).unwrap()
}

fn known(batch: &Series) -> Observed<'_> {
    batch.observed(CONTEXT as usize)
}

/// The batch with other positions in the horizon.
fn with_other_future(batch: &Series) -> Series {
    let mut other = batch.clone();
    for y in other.y_mut().chunks_exact_mut(ROW) {
        for value in &mut y[CONTEXT_VALUES..] {
            *value = 100.0 - *value;
        }
    }
    other
}

#[test]
fn a_model_predicts_what_its_trainer_validated() {
    for normalization in [Normalization::Context, Normalization::Dataset] {
        let trainer = trainer(normalization);
        let batch = batch(50, 5);
        let predicted = model(&trainer).predict(&known(&batch)).unwrap();
        let horizon = (SAMPLES - CONTEXT) as usize;
        let mut total = 0.0;
        for (predicted, truth) in predicted.chunks(horizon * JOINTS).zip(batch.y().chunks(ROW)) {
            for joint in 0..JOINTS {
                let error = |sample: usize| {
                    predicted[sample * JOINTS + joint]
                        - truth[CONTEXT_VALUES + sample * JOINTS + joint]
                };
                let squares: f32 = (0..horizon).map(|sample| error(sample).powi(2)).sum();
                total += f64::from(squares / horizon as f32).sqrt();
            }
        }
        let rmse = total / (5 * JOINTS) as f64;
        let reported = trainer.validate(&ValidationPart::whole(&batch)).unwrap().rmse_rad();
        assert!((rmse - reported).abs() < 1e-6 * reported, "{rmse} {reported}");
    }
}

#[test]
fn many_trajectories_are_answered_as_each_alone() {
    let model = model(&trainer(Normalization::Context));
    let batch = batch(51, 130);
    let all = model.predict(&known(&batch)).unwrap();
    let answer = all.len() / 130;
    for index in [0, 63, 64, 129] {
        let one = model.predict(&known(&batch).pick(&[index])).unwrap();
        for (one, among) in one.iter().zip(&all[index * answer..][..answer]) {
            assert!((one - among).abs() < 1e-5, "{one} {among}");
        }
    }
}

#[test]
fn later_torques_do_not_change_earlier_predictions() {
    let model = model(&trainer(Normalization::Context));
    let batch = batch(52, 1);
    let mut other = batch.clone();
    // Changes u from the second token of the horizon on. A token has four samples.
    for value in &mut other.u_mut()[CONTEXT_VALUES + 4 * JOINTS..] {
        *value += 3.0;
    }
    let (first, second) =
        (model.predict(&known(&batch)).unwrap(), model.predict(&known(&other)).unwrap());
    assert_eq!(first[..4 * JOINTS], second[..4 * JOINTS]);
    assert_ne!(first[4 * JOINTS..], second[4 * JOINTS..]);
}

#[test]
fn no_prediction_depends_on_the_positions_of_the_horizon() {
    for normalization in [Normalization::Context, Normalization::Dataset] {
        let model = model(&trainer(normalization));
        let batch = batch(53, 3);
        let answer = model.predict_with_leak(&batch.view()).unwrap();
        assert_eq!(answer, model.predict_with_leak(&with_other_future(&batch).view()).unwrap());
        assert_eq!(answer, model.predict(&known(&batch)).unwrap());
        assert!(!model.needs_leak());
    }
}

#[test]
fn the_papers_normalization_leaks_and_says_so() {
    let model = model(&trainer(Normalization::PaperLeaky));
    let batch = batch(54, 3);
    assert!(model.needs_leak());
    assert!(matches!(model.predict(&known(&batch)), Err(ModelError::LeakRequired)));
    let honest = model.predict_with_leak(&batch.view()).unwrap();
    assert_ne!(honest, model.predict_with_leak(&with_other_future(&batch).view()).unwrap());
}

#[test]
fn a_joint_that_stands_still_is_predicted_with_finite_numbers() {
    let model = model(&trainer(Normalization::Context));
    let shape = Shape { robots: 1, samples: SAMPLES as usize, joints: JOINTS };
    let still = Series::new(shape, DATA.rate_hz, vec![0.0; ROW], vec![0.25; ROW]).unwrap();
    let answer = model.predict(&known(&still)).unwrap();
    assert!(answer.iter().all(|value| (value - 0.25).abs() < 0.1), "{answer:?}");
}

#[test]
fn a_question_of_the_wrong_shape_is_refused() {
    let model = model(&trainer(Normalization::Context));
    let batch = batch(55, 2);
    let refused = |question: &Observed<'_>| model.predict(question).unwrap_err().to_string();
    let shorter = CONTEXT as usize - 1;
    let error = refused(&batch.observed(shorter));
    assert_eq!(error, "the model was given 15 samples of y, expected 16");
    let error = refused(&batch.view().observed(1, shorter));
    assert_eq!(error, "the model was given 23 samples of u, expected 24");
    let shape = Shape { joints: JOINTS - 1, ..batch.shape() };
    let [u, y] = [batch.u(), batch.y()].map(|values| values[..shape.values().unwrap()].to_vec());
    let narrower = Series::new(shape, DATA.rate_hz, u, y).unwrap();
    assert_eq!(refused(&known(&narrower)), "the model was given 6 joints, expected 7");
}

#[test]
fn a_model_can_be_shared_between_threads() {
    fn check<T: Send + Sync>() {}
    check::<TrainedModel>();
}
