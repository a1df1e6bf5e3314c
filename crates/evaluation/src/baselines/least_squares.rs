//! A linear baseline of the first order.

use nalgebra::{Matrix3, Vector3};
use series::Observed;

use super::rollout::{mean_velocities, rollout};
use crate::{EvaluationError, Predictor};

/// v' = a·v + g·u + b per joint, with a, g and b of each robot fitted to its context. It is ARX of
/// order 1.
///
/// v is the mean velocity over a sampling period. So a first-order lag (the joint's own inertia and
/// damping) is represented exactly, and coupling between joints is left out.
#[derive(Clone, Copy, Debug)]
pub struct LeastSquares;

impl Predictor for LeastSquares {
    fn name(&self) -> &'static str {
        "least-squares"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |scenario, joint| {
            let [a, g, b] = fit_first_order(observed, scenario, joint);
            move |velocity, torque| a * velocity + g * torque + b
        }))
    }
}

/// Least squares of v[k] on (v[k-1], u[k], 1) over the context, with a very small ridge.
///
/// If the context is too short or has too little motion, the law is that of a held joint.
fn fit_first_order(observed: &Observed<'_>, scenario: usize, joint: usize) -> [f64; 3] {
    let torques = observed.u(scenario);
    let period = 1.0 / observed.rate_hz();
    let velocities: Vec<f64> = mean_velocities(observed.y(scenario), joint, period).collect();
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (velocity, torque) in velocities.windows(2).zip(torques.iter().skip(1)) {
        let row = Vector3::new(velocity[0], f64::from(torque[joint]), 1.0);
        normal += row * row.transpose();
        right += row * velocity[1];
    }
    let ridge = 1e-9 * normal.trace();
    normal += Matrix3::identity() * ridge;
    match normal.cholesky() {
        Some(factor) => {
            let [a, g, b] = factor.solve(&right).into();
            // With a beyond 1 the rollout would grow without bound. No damped joint does that.
            [a.clamp(-1.0, 1.0), g, b]
        }
        None => [0.0; 3],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baselines::fixture::{error_of, first_order_robot};

    #[test]
    fn least_squares_identifies_a_first_order_arm() {
        assert!(error_of(&LeastSquares, &first_order_robot(0.8, 0.03)) < 1e-2);
    }

    #[test]
    fn least_squares_holds_an_arm_that_does_not_move() {
        let mut still = first_order_robot(0.0, 0.0);
        still.u_mut().fill(0.0);
        assert!(error_of(&LeastSquares, &still) < 1e-9);
    }
}
