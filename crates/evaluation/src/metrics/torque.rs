//! The torque that a model of an arm says for a measured motion, beside the torque that acted.

use dynamics::{Joints, Robot, inverse_dynamics};

/// Least time over which positions are differentiated, s. At higher rates rounded positions would
/// dominate their second differences.
const LEAST_STEP_S: f64 = 1.0 / 60.0;

/// Root mean square of the torque that `arm` takes for a measured motion minus the torque that
/// acted, for each joint, N·m. Torques and positions (rad) are `[sample, joint]`. `None` if the
/// motion is too short for a second difference.
///
/// Velocities and accelerations are central differences. The second difference of positions is a
/// mean of accelerations with triangular weights. Each torque is held from its sample to the next,
/// so the same mean of torques acts.
pub(crate) fn torque_rmse_nm(
    arm: &Robot,
    rate_hz: f64,
    torques: &[f32],
    positions: &[f32],
) -> Option<Vec<f64>> {
    let joints = arm.joints();
    let samples = positions.len() / joints;
    let reach = step(rate_hz);
    let seconds = reach as f64 / rate_hz;
    let weights: Vec<f64> = (0..2 * reach).map(|k| weight(k, reach)).collect();
    let at = |sample: usize, joint: usize| f64::from(positions[sample * joints + joint]);

    let middles = reach..samples.checked_sub(reach)?;
    let count = middles.len();
    let mut squares = vec![0.0; joints];
    for middle in middles {
        let q = Joints::from_fn(joints, |joint| at(middle, joint));
        let before = Joints::from_fn(joints, |joint| at(middle - reach, joint));
        let after = Joints::from_fn(joints, |joint| at(middle + reach, joint));
        let qd = Joints::from_fn(joints, |joint| (after[joint] - before[joint]) / (2.0 * seconds));
        let qdd = Joints::from_fn(joints, |joint| {
            (after[joint] - 2.0 * q[joint] + before[joint]) / (seconds * seconds)
        });
        let taken = inverse_dynamics(arm, q, qd, qdd);
        let acting = &torques[(middle - reach) * joints..][..2 * reach * joints];
        for (joint, square) in squares.iter_mut().enumerate() {
            let held = acting.iter().skip(joint).step_by(joints);
            let acted: f64 =
                held.zip(&weights).map(|(torque, weight)| f64::from(*torque) * weight).sum();
            *square += (taken[joint] - acted).powi(2);
        }
    }
    (count > 0).then(|| squares.iter().map(|sum| (sum / count as f64).sqrt()).collect())
}

/// The share of the `k`th of `2 · reach` periods in the second difference over `reach` periods.
fn weight(k: usize, reach: usize) -> f64 {
    let (k, reach) = (k as f64, reach as f64);
    (reach - (k + 0.5 - reach).abs()) / (reach * reach)
}

/// Number of periods of at least [`LEAST_STEP_S`] together.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rates are at most 1000 Hz"
)]
fn step(rate_hz: f64) -> usize {
    (LEAST_STEP_S * rate_hz - 1e-9).ceil().max(1.0) as usize
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use spec::JobSpec;

    use super::*;

    /// The largest error over joints and robots of two seconds at `rate_hz`, with the masses of the
    /// arm in the given proportion to the true ones. Arms feel gravity.
    fn largest(rate_hz: u32, masses: f64) -> f64 {
        let text = serde_json::json!({
            "kind": "simulate", "trajectories": 8, "samples": 2 * rate_hz, "rate_hz": rate_hz,
            "excitation": {"multisine": {"frequency_hz": {"fixed": 0.15}}},
            "robot": {"gravity": "compensated"},
        });
        let JobSpec::Simulate(spec) = spec::parse(text.to_string().as_bytes()).unwrap() else {
            panic!("a simulation");
        };
        let go_on = |_| ControlFlow::Continue(());
        let simulated = dynamics::simulate(&spec, 0..8, &go_on).unwrap();
        let series = simulated.series.view();
        let robots = simulated.scenarios.iter().enumerate();
        let of_robot = |(k, scenario): (usize, &dynamics::Scenario)| {
            let mut arm = scenario.robot.clone();
            for link in arm.links.iter_mut() {
                link.mass *= masses;
            }
            let (u, q) = (series.u(k).values(), series.true_y(k).values());
            let errors = torque_rmse_nm(&arm, rate_hz.into(), u, q).unwrap();
            errors.into_iter().fold(0.0, f64::max)
        };
        robots.map(of_robot).fold(0.0, f64::max)
    }

    #[test]
    fn the_true_arm_takes_the_torque_that_acted_at_every_rate_and_a_heavier_one_more() {
        for rate_hz in [60, 100, 500] {
            let (own, heavier) = (largest(rate_hz, 1.0), largest(rate_hz, 1.1));
            assert!(own < 0.1, "{rate_hz} Hz: {own}");
            assert!(heavier > 1.0, "{rate_hz} Hz: {heavier}");
        }
    }

    #[test]
    fn a_motion_without_a_second_difference_has_no_error() {
        let arm = Robot::panda();
        assert_eq!(torque_rmse_nm(&arm, 60.0, &[0.0; 14], &[0.0; 14]), None);
        assert_eq!(torque_rmse_nm(&arm, 60.0, &[0.0; 21], &[0.0; 21]), Some(vec![0.0; 7]));
    }

    #[test]
    fn weights_are_those_of_a_second_difference() {
        let of = |reach: usize| -> Vec<f64> { (0..2 * reach).map(|k| weight(k, reach)).collect() };
        assert_eq!(of(1), [0.5, 0.5]);
        assert_eq!(of(2), [0.125, 0.375, 0.375, 0.125]);
        assert_eq!([60.0, 61.0, 120.0, 1000.0].map(step), [1, 2, 2, 17]);
    }
}
