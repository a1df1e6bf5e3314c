use serde::{Deserialize, Serialize};
use spec::{Family, JOINTS};

use crate::{EvaluationError, Predictor, Scenarios, rmse_deg};

/// The errors of every predictor on the same scenarios of one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellResult {
    pub cell: usize,
    pub family: Family,
    pub frequency_hz: f64,
    /// Index of the first scenario in the dataset; the others follow.
    pub first: u64,
    pub predictors: Vec<PredictorErrors>,
}

/// One predictor's error on each scenario of a cell, in order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictorErrors {
    pub predictor: String,
    pub rmse_deg: Vec<f64>,
}

/// Asks each predictor the same question and scores the answers.
///
/// # Errors
/// A predictor that fails, or answers with another length or a value that is not finite.
pub fn evaluate_cell(
    scenarios: &Scenarios,
    context: usize,
    predictors: &[Box<dyn Predictor + '_>],
) -> Result<Vec<PredictorErrors>, EvaluationError> {
    let observed = scenarios.observed(context);
    let values_per_scenario = observed.horizon() * JOINTS;
    predictors
        .iter()
        .map(|predictor| {
            let name = predictor.name().to_owned();
            let predicted = predictor.predict(&observed)?;
            let expected = scenarios.size * values_per_scenario;
            if predicted.len() != expected {
                let got = predicted.len();
                return Err(EvaluationError::WrongLength { predictor: name, got, expected });
            }
            if let Some(at) = predicted.iter().position(|value| !value.is_finite()) {
                let scenario = at / values_per_scenario;
                return Err(EvaluationError::NotFinite { predictor: name, scenario });
            }
            let rmse_deg = rmse_deg(scenarios, context, &predicted);
            Ok(PredictorErrors { predictor: name, rmse_deg })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HoldLast, Observed};

    struct Broken(f32);

    impl Predictor for Broken {
        fn name(&self) -> &'static str {
            "broken"
        }

        fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError> {
            let mut predicted = HoldLast.predict(observed)?;
            *predicted.last_mut().unwrap() = self.0;
            Ok(predicted)
        }
    }

    #[test]
    fn a_value_that_is_not_finite_is_reported_with_its_scenario_and_not_averaged_away() {
        let y = vec![0.1; 3 * 4 * JOINTS];
        let scenarios = Scenarios { size: 3, samples: 4, rate_hz: 60.0, u: y.clone(), y };
        let predictors: Vec<Box<dyn Predictor>> = vec![Box::new(Broken(f32::NAN))];
        let error = evaluate_cell(&scenarios, 2, &predictors).unwrap_err();
        assert!(matches!(error, EvaluationError::NotFinite { scenario: 2, .. }), "{error}");
    }

    /// No leak: positions of the horizon never reach a predictor.
    #[test]
    fn noise_in_the_horizon_changes_no_prediction() {
        let y: Vec<f32> = (0..2 * 6 * JOINTS).map(|k| (k as f32).sin()).collect();
        let scenarios = Scenarios { size: 2, samples: 6, rate_hz: 60.0, u: y.clone(), y };
        let mut noisy = scenarios.clone();
        for trajectory in noisy.y.chunks_exact_mut(6 * JOINTS) {
            trajectory[4 * JOINTS..].fill(f32::NAN);
        }
        assert_eq!(scenarios.observed(4), noisy.observed(4));
    }
}
