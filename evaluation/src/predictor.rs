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

    /// Samples that it says at a time, of one whose answers have seams between them; counted from the
    /// first sample of the horizon.
    fn patch(&self) -> Option<usize> {
        None
    }

    /// The prediction, and `count` samples of what it holds possible, from 2 on. A predictor that has
    /// one answer only has no samples.
    fn answer(&self, observed: &Observed<'_>, count: usize) -> Result<Answer, EvaluationError> {
        let _ = count;
        Ok(Answer { positions: self.predict(observed)?, samples: None })
    }
}
