//! Predictors that learn nothing from other robots: what a learned model has to beat.

use nalgebra::{Matrix3, Vector3};
use spec::{Baseline, JOINTS};

use crate::{EvaluationError, Observed, Predictor};

/// The predictor that `baseline` names, for arms of nominal damping `damping_nm_s_rad`.
pub fn baseline(baseline: Baseline, damping_nm_s_rad: [f64; JOINTS]) -> Box<dyn Predictor> {
    match baseline {
        Baseline::HoldLast => Box::new(HoldLast),
        Baseline::DampedIntegrator => Box::new(DampedIntegrator { damping_nm_s_rad }),
        Baseline::LeastSquares => Box::new(LeastSquares),
    }
}

/// The last context position, held.
#[derive(Clone, Copy, Debug)]
pub struct HoldLast;

impl Predictor for HoldLast {
    fn name(&self) -> &'static str {
        "hold-last"
    }

    fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |_, _| |_, _| 0.0))
    }
}

/// q̇ = u / D: the arm as seven dampers, from the last context position.
#[derive(Clone, Copy, Debug)]
pub struct DampedIntegrator {
    /// Nominal, not each robot's own. A joint without damping is held.
    pub damping_nm_s_rad: [f64; JOINTS],
}

impl Predictor for DampedIntegrator {
    fn name(&self) -> &'static str {
        "damped-integrator"
    }

    fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |_, joint| {
            let damping = self.damping_nm_s_rad[joint];
            let gain = if damping > 0.0 { 1.0 / damping } else { 0.0 };
            move |_, torque| gain * torque
        }))
    }
}

/// v' = a·v + g·u + b per joint, with a, g and b of each robot fitted to its context.
///
/// v is the mean velocity over a sampling period, so a first-order lag (the joint's own inertia
/// and damping) is represented exactly and coupling between joints is not.
#[derive(Clone, Copy, Debug)]
pub struct LeastSquares;

impl Predictor for LeastSquares {
    fn name(&self) -> &'static str {
        "least-squares"
    }

    fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError> {
        Ok(rollout(observed, |scenario, joint| {
            let [a, g, b] = fit_first_order(observed, scenario, joint);
            move |velocity, torque| a * velocity + g * torque + b
        }))
    }
}

/// Integrates each joint's velocity law over the horizon, starting at the last context sample.
///
/// `law(scenario, joint)` gives the velocity over a period from the one before and the torque.
fn rollout<Velocity: Fn(f64, f64) -> f64>(
    observed: &Observed,
    law: impl Fn(usize, usize) -> Velocity,
) -> Vec<f32> {
    let horizon = observed.horizon();
    let period = 1.0 / observed.rate_hz;
    let mut predicted = vec![0.0; observed.size * horizon * JOINTS];
    for scenario in 0..observed.size {
        let torques = observed.torques(scenario);
        let positions = observed.positions(scenario);
        for joint in 0..JOINTS {
            let velocity_of = law(scenario, joint);
            let last = observed.context - 1;
            let mut position = f64::from(positions[last][joint]);
            let mut velocity = mean_velocities(positions, joint, period).last().unwrap_or(0.0);
            for step in 0..horizon {
                velocity = velocity_of(velocity, f64::from(torques[last + step][joint]));
                position += velocity * period;
                predicted[(scenario * horizon + step) * JOINTS + joint] = to_f32(position);
            }
        }
    }
    predicted
}

/// Mean velocity of a joint over each sampling period, in rad/s: one fewer than positions.
fn mean_velocities(
    positions: &[[f32; JOINTS]],
    joint: usize,
    period: f64,
) -> impl Iterator<Item = f64> {
    positions
        .windows(2)
        .map(move |pair| (f64::from(pair[1][joint]) - f64::from(pair[0][joint])) / period)
}

/// Least squares of v[k] on (v[k-1], u[k], 1) over the context, with a ridge far below the data.
///
/// A context too short or too still to tell gives the law of a held joint.
fn fit_first_order(observed: &Observed, scenario: usize, joint: usize) -> [f64; 3] {
    let torques = observed.torques(scenario);
    let period = 1.0 / observed.rate_hz;
    let velocities: Vec<f64> =
        mean_velocities(observed.positions(scenario), joint, period).collect();
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (velocity, torque) in velocities.windows(2).zip(&torques[1..]) {
        let row = Vector3::new(velocity[0], f64::from(torque[joint]), 1.0);
        normal += row * row.transpose();
        right += row * velocity[1];
    }
    let ridge = 1e-9 * normal.trace();
    normal += Matrix3::identity() * ridge;
    match normal.cholesky() {
        Some(factor) => {
            let [a, g, b] = factor.solve(&right).into();
            // Beyond 1 the rollout would grow without bound, which no damped joint does.
            [a.clamp(-1.0, 1.0), g, b]
        }
        None => [0.0; 3],
    }
}

#[expect(clippy::cast_possible_truncation, reason = "datasets hold f32")]
fn to_f32(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scenarios, rmse_deg};

    /// One robot whose joints obey v' = a·v + g·u exactly.
    fn first_order_robot(a: f64, g: f64) -> Scenarios {
        let (samples, rate_hz) = (400, 60.0);
        let mut scenarios = Scenarios { size: 1, samples, rate_hz, u: vec![], y: vec![] };
        let mut position = [0.5; JOINTS];
        let mut velocity = [0.0; JOINTS];
        for k in 0..samples {
            for joint in 0..JOINTS {
                let torque = (0.07 * (k as f64) * (1.0 + 0.3 * joint as f64)).sin();
                scenarios.u.push(to_f32(torque));
                scenarios.y.push(to_f32(position[joint]));
                velocity[joint] = a * velocity[joint] + g * f64::from(to_f32(torque));
                position[joint] += velocity[joint] / rate_hz;
            }
        }
        scenarios
    }

    fn error_of(predictor: &dyn Predictor, scenarios: &Scenarios) -> f64 {
        let predicted = predictor.predict(&scenarios.observed(320)).unwrap();
        rmse_deg(scenarios, 320, &predicted)[0]
    }

    #[test]
    fn hold_last_repeats_the_last_context_position() {
        let observed = first_order_robot(0.0, 0.1).observed(320);
        let predicted = HoldLast.predict(&observed).unwrap();
        assert_eq!(predicted.len(), 80 * JOINTS);
        assert!(predicted.as_chunks().0.iter().all(|y| *y == observed.positions(0)[319]));
    }

    #[test]
    fn the_damped_integrator_is_exact_for_a_massless_arm_of_that_damping() {
        let predictor = DampedIntegrator { damping_nm_s_rad: [10.0; JOINTS] };
        assert!(error_of(&predictor, &first_order_robot(0.0, 0.1)) < 1e-4);
        assert!(error_of(&predictor, &first_order_robot(0.0, 0.2)) > 0.1);
    }

    #[test]
    fn least_squares_identifies_a_first_order_arm() {
        assert!(error_of(&LeastSquares, &first_order_robot(0.8, 0.03)) < 1e-2);
    }

    #[test]
    fn least_squares_holds_an_arm_that_does_not_move() {
        let mut still = first_order_robot(0.0, 0.0);
        still.u.fill(0.0);
        assert!(error_of(&LeastSquares, &still) < 1e-9);
    }
}
