//! Baselines on contexts whose noise is removed first.

use dynamics::Robot;
use models::Interrupt;
use rayon::prelude::*;
use series::{JointMotion, Observed, Series, Shape, ShapeError, Smoother};

use crate::predictor::Answer;
use crate::{EvaluationError, Predictor};

/// A baseline that gets smoothed positions.
///
/// A filter that knows the noise of the positions smooths the context joint by joint
/// ([`Smoother`]). Velocities, the fit and the start of the prediction then follow from the
/// smoothed motion. Positions without noise are passed on unchanged.
pub(super) struct Filtered(pub Box<dyn Predictor>);

impl Predictor for Filtered {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        match smoothed(observed)? {
            Some(smoothed) => self.0.predict(&smoothed.observed(observed.context())),
            None => self.0.predict(observed),
        }
    }

    fn answer(&self, observed: &Observed<'_>, count: usize) -> Result<Answer, EvaluationError> {
        match smoothed(observed)? {
            Some(smoothed) => self.0.answer(&smoothed.observed(observed.context()), count),
            None => self.0.answer(observed, count),
        }
    }

    /// Torques of the context are not smoothed, so they are the same with and without the filter.
    fn torques(
        &self,
        observed: &Observed<'_>,
        answer: &Answer,
        motions: &[JointMotion],
    ) -> Result<Option<Vec<Vec<f64>>>, EvaluationError> {
        self.0.torques(observed, answer, motions)
    }
}

/// The window of `observed` with smoothed positions over its context. It has no later positions.
/// `None` if the positions have no noise.
pub(super) fn smoothed(observed: &Observed<'_>) -> Result<Option<Series>, ShapeError> {
    let deviation_rad = observed.noise().position_rad;
    if deviation_rad <= 0.0 {
        return Ok(None);
    }
    let Shape { robots, joints, .. } = observed.shape();
    let (context, rate_hz) = (observed.context(), observed.rate_hz());
    let smoother = Smoother::new(context, rate_hz, deviation_rad);
    let mut u = Vec::new();
    let mut y = Vec::new();
    let interrupt = Interrupt::current();
    for robot in 0..robots {
        interrupt.leave_if_raised();
        u.extend_from_slice(observed.u(robot).values());
        y.extend(smoother.smooth_robot(observed.y(robot).values(), joints));
    }
    Series::question(observed.shape(), context, rate_hz, u, y).map(Some)
}

/// The answer of a predictor that fits arms. `predict_one` gets the window with [`smoothed`]
/// positions, the measured window and a scenario. It gives an arm and the positions
/// `[horizon, joint]`, rad.
pub(super) fn answer_with_arms(
    measured: &Observed<'_>,
    predict_one: impl Fn([&Observed<'_>; 2], usize, &Interrupt) -> (Robot, Vec<f32>) + Sync,
) -> Result<Answer, EvaluationError> {
    let interrupt = Interrupt::current();
    let smoothed = smoothed(measured)?;
    let smoothed = smoothed.as_ref().map(|series| series.observed(measured.context()));
    let asked = [smoothed.as_ref().unwrap_or(measured), measured];
    let one = |scenario| {
        interrupt.leave_if_raised();
        predict_one(asked, scenario, &interrupt)
    };
    let (arms, positions): (Vec<Robot>, Vec<Vec<f32>>) =
        (0..measured.robots()).into_par_iter().map(one).unzip();
    Ok(Answer { positions: positions.concat(), arms: Some(arms), samples: None })
}

/// The last position of a scenario, over the horizon: `[horizon, joint]`, rad.
pub(super) fn held(observed: &Observed<'_>, scenario: usize) -> Vec<f32> {
    let positions = observed.y(scenario);
    positions[positions.samples() - 1].repeat(observed.horizon())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baselines::fixture::first_order_robot;
    use crate::{FittedDamping, HoldLast};

    const NOISE_RAD: f64 = 2e-3;
    const CONTEXT: usize = 320;

    fn noisy(seed: u64) -> Series {
        let mut robot = first_order_robot(0.8, 0.03);
        dynamics::add_position_noise(&mut robot, NOISE_RAD, CONTEXT, seed, 0);
        robot
    }

    /// Root mean square of the first predicted position minus the last true one of the context,
    /// rad.
    fn error_at_start(predictor: &dyn Predictor) -> f64 {
        let squares = (0..20).map(|seed| {
            let robot = noisy(seed);
            let predicted = predictor.predict(&robot.observed(CONTEXT)).unwrap();
            let view = robot.view();
            let truth = &view.true_y(0)[CONTEXT - 1];
            predicted.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 7.0
        });
        (squares.sum::<f64>() / 20.0).sqrt()
    }

    #[test]
    fn a_prediction_starts_nearer_to_the_truth_than_what_was_measured() {
        let (filtered, raw) =
            (error_at_start(&Filtered(Box::new(HoldLast))), error_at_start(&HoldLast));
        assert!((raw / NOISE_RAD - 1.0).abs() < 0.2, "{raw}");
        assert!(filtered < 0.75 * raw, "{filtered} {raw}");
    }

    #[test]
    fn positions_without_noise_are_handed_on_to_the_bit() {
        let robot = first_order_robot(0.8, 0.03);
        let observed = robot.observed(CONTEXT);
        let filtered = Filtered(Box::new(FittedDamping)).predict(&observed).unwrap();
        assert_eq!(filtered, FittedDamping.predict(&observed).unwrap());
    }

    /// Samples after the context must not influence the smoothed context.
    #[test]
    fn the_filter_ends_with_the_context() {
        let robot = noisy(3);
        let mut other = robot.clone();
        other.y_mut()[CONTEXT * 7..].fill(9.0);
        let predictor = Filtered(Box::new(FittedDamping));
        let answers =
            [&robot, &other].map(|arm| predictor.predict(&arm.observed(CONTEXT)).unwrap());
        assert_eq!(answers[0], answers[1]);
    }
}
