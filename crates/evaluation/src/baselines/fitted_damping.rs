//! A baseline of dampings alone, which are fitted.

use series::Observed;

use super::rollout::rollout;
use crate::{EvaluationError, Predictor};

/// q̇ = u / D with D of each joint of each robot fitted to its context. It is an identification of
/// the damping alone.
#[derive(Clone, Copy, Debug)]
pub struct FittedDamping;

impl Predictor for FittedDamping {
    fn name(&self) -> &'static str {
        "fitted-damping"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |scenario, joint| {
            let gain = fit_gain(observed, scenario, joint);
            move |_, torque| gain * torque
        }))
    }
}

/// 1 / D of y[k] = c + Σ u / D · period, by least squares over the context, with a free c.
///
/// Sums of torques are fitted to positions, and not torques to velocities, because a prediction is
/// such a sum. On simulated arms this predicts better at nearly every frequency. A joint that moves
/// against its torque is held.
fn fit_gain(observed: &Observed<'_>, scenario: usize, joint: usize) -> f64 {
    let period = 1.0 / observed.rate_hz();
    let positions = observed.y(scenario);
    let mut impulse = 0.0;
    let (mut impulses, mut squares) = (0.0, 0.0);
    let (mut travels, mut products) = (0.0, 0.0);
    for (position, torque) in positions.iter().zip(observed.u(scenario)) {
        // Distances are from the first position, so that no large numbers cancel.
        let travel = f64::from(position[joint]) - f64::from(positions[0][joint]);
        impulses += impulse;
        squares += impulse * impulse;
        travels += travel;
        products += impulse * travel;
        impulse += f64::from(torque[joint]) * period;
    }
    let count = positions.samples() as f64;
    let variance = squares - impulses * impulses / count;
    let covariance = products - impulses * travels / count;
    if variance > 0.0 { (covariance / variance).max(0.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baselines::fixture::{error_of, first_order_robot};

    #[test]
    fn the_damping_of_a_massless_arm_is_found_whatever_it_is() {
        for gain in [0.02, 0.1, 0.7] {
            assert!(error_of(&FittedDamping, &first_order_robot(0.0, gain)) < 1e-3);
        }
    }

    #[test]
    fn a_joint_that_never_moves_is_held() {
        let mut still = first_order_robot(0.0, 0.1);
        still.y_mut().fill(0.3);
        assert!(error_of(&FittedDamping, &still) < 1e-9);
    }
}
