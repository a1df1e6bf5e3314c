use models::{Batch, PredictionInput, TrainedModel};

use crate::{EvaluationError, Observed, Predictor, Scenarios};

/// A checkpoint as a predictor.
pub struct Learned<'a> {
    pub name: String,
    pub model: &'a TrainedModel,
}

/// A checkpoint whose normalization takes its statistics from the horizon too, as in the paper's
/// code. It holds what it is to predict, which is why it is a predictor apart, and named so in
/// every table.
pub struct LeakyLearned<'a> {
    pub name: String,
    pub model: &'a TrainedModel,
    pub scenarios: &'a Scenarios,
}

impl Predictor for Learned<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError> {
        let input = PredictionInput {
            u: observed.u.clone(),
            y_context: observed.y.clone(),
            size: observed.size,
        };
        self.model.predict(&input).map_err(|source| failed(&self.name, source))
    }
}

impl Predictor for LeakyLearned<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError> {
        let batch = Batch {
            u: observed.u.clone(),
            y: self.scenarios.y.clone(),
            size: observed.size,
            samples: observed.samples,
        };
        self.model.predict_with_leak(&batch).map_err(|source| failed(&self.name, source))
    }
}

fn failed(predictor: &str, source: models::ModelError) -> EvaluationError {
    EvaluationError::Model { predictor: predictor.to_owned(), source }
}
