//! The torque that a predictor says for a measured motion, beside the torque that acted.

use dynamics::{Joints, Robot, inverse_dynamics};
use series::JointMotion;

/// The torques that a motion takes of an arm, `[instant, joint]`, N·m.
pub(crate) fn torques_of_arm(arm: &Robot, motion: &JointMotion) -> Vec<f64> {
    let joints = motion.joints();
    let of_instant = |instant: usize| {
        let at = |values: &[f64]| -> Joints<f64> {
            values[instant * joints..][..joints].iter().copied().collect()
        };
        let torques = inverse_dynamics(arm, at(motion.q()), at(motion.qd()), at(motion.qdd()));
        (0..joints).map(move |joint| torques[joint])
    };
    (0..motion.instants()).flat_map(of_instant).collect()
}

/// Root mean square of the torques that a predictor says minus those that acted, both `[instant,
/// joint]`, for each joint, N·m. `None` without an instant, or if a torque is not finite.
pub(crate) fn torque_rmse_nm(said: &[f64], acted: &[f64], joints: usize) -> Option<Vec<f64>> {
    let instants = acted.len() / joints;
    let mut squares = vec![0.0; joints];
    for (said, acted) in said.chunks_exact(joints).zip(acted.chunks_exact(joints)) {
        for (square, (said, acted)) in squares.iter_mut().zip(said.iter().zip(acted)) {
            *square += (said - acted).powi(2);
        }
    }
    let rmse: Vec<f64> = squares.into_iter().map(|sum| (sum / instants as f64).sqrt()).collect();
    rmse.iter().all(|rmse| rmse.is_finite()).then_some(rmse)
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use series::mean_torques;
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
            let joints = series.joints();
            let motion = JointMotion::measured(q, joints, rate_hz.into());
            let said = torques_of_arm(&arm, &motion);
            let errors =
                torque_rmse_nm(&said, &mean_torques(u, joints, rate_hz.into()), joints).unwrap();
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
    fn nothing_said_and_nothing_finite_have_no_error() {
        assert_eq!(torque_rmse_nm(&[], &[], 2), None);
        assert_eq!(torque_rmse_nm(&[f64::NAN, 0.0], &[0.0; 2], 2), None);
        assert_eq!(
            torque_rmse_nm(&[3.0, 0.0, 1.0, 0.0], &[0.0; 4], 2),
            Some(vec![5_f64.sqrt(), 0.0])
        );
    }
}
