use series::Observed;

use crate::EvaluationError;

/// Several answers to one question, each as likely as the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    pub count: usize,
    /// Positions `[sample, robot, horizon, joint]`, rad.
    pub positions: Vec<f32>,
}

/// One prediction, and samples where they were asked for and there are any.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Positions `[robot, horizon, joint]`, rad.
    pub positions: Vec<f32>,
    pub samples: Option<Samples>,
}

impl Answer {
    /// Of a predictor whose prediction is its first sample. Below two samples there is a prediction
    /// alone.
    pub(crate) fn of_samples(count: usize, positions: Vec<f32>) -> Self {
        if count < 2 {
            return Self { positions, samples: None };
        }
        let first = positions[..positions.len() / count].to_vec();
        Self { positions: first, samples: Some(Samples { count, positions }) }
    }
}

/// Anything that answers how the arm will move.
pub trait Predictor {
    /// How tables and figures call it.
    fn name(&self) -> &str;

    /// Positions of the horizon, `[robot, horizon, joint]`, in rad.
    ///
    /// A scenario without an answer has values that are not finite; it is reported as such.
    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError>;

    /// `count` samples of what it holds possible; `None` from a predictor that has one answer only.
    fn sample(
        &self,
        observed: &Observed<'_>,
        count: usize,
    ) -> Result<Option<Samples>, EvaluationError> {
        let _ = (observed, count);
        Ok(None)
    }

    /// The prediction, and `count` samples from 2 on.
    fn answer(&self, observed: &Observed<'_>, count: usize) -> Result<Answer, EvaluationError> {
        let positions = self.predict(observed)?;
        let samples = if count < 2 { None } else { self.sample(observed, count)? };
        Ok(Answer { positions, samples })
    }
}
