//! The trait of predictors, which evaluations compare, and their answers.

use dynamics::Robot;
use rayon::prelude::*;
use series::{JointMotion, Observed};

use crate::EvaluationError;
use crate::metrics::torques_of_arm;

/// Several equally likely answers to one question.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// Number of samples.
    pub count: usize,
    /// Positions `[sample, robot, horizon, joint]`, rad.
    pub positions: Vec<f32>,
}

/// One prediction, with samples if the caller asked for them and the predictor has any.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    /// Positions `[robot, horizon, joint]`, rad.
    pub positions: Vec<f32>,
    /// Samples of its distribution.
    pub samples: Option<Samples>,
    /// The arm of each robot by which the predictor explains the context. `None` for a predictor
    /// that simulates no arm.
    pub arms: Option<Vec<Robot>>,
}

impl Answer {
    /// The answer of a predictor whose prediction is its first sample. Below two samples it has
    /// only the prediction.
    pub(crate) fn of_samples(count: usize, positions: Vec<f32>) -> Self {
        if count < 2 {
            return Self { positions, ..Self::default() };
        }
        let first = positions[..positions.len() / count].to_vec();
        let samples = Some(Samples { count, positions });
        Self { positions: first, samples, ..Self::default() }
    }
}

/// A predictor of the motion of arms.
///
/// This one predicts that arms go on with the velocity at the end of their context:
///
/// ```
/// use evaluation::{EvaluationError, Predictor};
/// use series::{Observed, Series, Shape};
///
/// struct GoOn;
///
/// impl Predictor for GoOn {
///     fn name(&self) -> &str {
///         "go-on"
///     }
///
///     fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
///         let last = observed.context() - 1;
///         let mut positions = Vec::new();
///         for robot in 0..observed.robots() {
///             let y = observed.y(robot);
///             for sample in 1..=observed.horizon() {
///                 for (now, before) in y[last].iter().zip(&y[last - 1]) {
///                     positions.push(now + sample as f32 * (now - before));
///                 }
///             }
///         }
///         Ok(positions)
///     }
/// }
///
/// // One robot with one joint, at 60 Hz: four samples of context, two of horizon.
/// let shape = Shape { robots: 1, samples: 6, joints: 1 };
/// let arm = Series::new(shape, 60.0, vec![0.0; 6], vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0])?;
/// assert_eq!(GoOn.predict(&arm.observed(4))?, [4.0, 5.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Predictor {
    /// The name in tables and figures.
    fn name(&self) -> &str;

    /// Positions of the horizon, `[robot, horizon, joint]`, in rad.
    ///
    /// A scenario that the predictor cannot predict has values that are not finite, and the report
    /// counts it.
    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError>;

    /// Number of samples in a patch, if the predictor predicts patch by patch. The first patch
    /// begins with the first sample of the horizon.
    fn patch(&self) -> Option<usize> {
        None
    }

    /// The prediction, and `count` samples of its distribution if `count` is at least 2. A
    /// predictor with a single answer has no samples.
    fn answer(&self, observed: &Observed<'_>, count: usize) -> Result<Answer, EvaluationError> {
        let _ = count;
        Ok(Answer { positions: self.predict(observed)?, ..Answer::default() })
    }

    /// The torques that a motion of each robot takes, `[instant, joint]`, N·m: the inverse
    /// question. `None` for a predictor that cannot say them. One that simulates arms says those of
    /// the arms of its `answer` to the same context.
    fn torques(
        &self,
        observed: &Observed<'_>,
        answer: &Answer,
        motions: &[JointMotion],
    ) -> Result<Option<Vec<Vec<f64>>>, EvaluationError> {
        let _ = observed;
        let of_robot = |(arm, motion)| torques_of_arm(arm, motion);
        Ok(answer.arms.as_ref().map(|arms| arms.par_iter().zip(motions).map(of_robot).collect()))
    }
}
