//! The robot itself.

use dynamics::{Joints, Motion, Replay, Robot};
use series::Observed;

use super::{NominalArm, Simulated};
use crate::predictor::Answer;
use crate::{EvaluationError, Predictor};

/// Simulates the robot of each scenario, which nobody has, under the torques of the horizon.
///
/// It starts with the true velocity and the last measured position, so with one sample of the
/// sensor's noise. Its error is what cannot be known: that noise, as the arm magnifies it, and the
/// course of the torques between two samples.
#[derive(Clone, Debug)]
pub struct Oracle {
    replay: Replay,
    /// The robot of each scenario of a question, in order, and its velocities at the last sample of
    /// the context, rad/s.
    robots: Vec<(Robot, Joints<f64>)>,
}

impl Oracle {
    /// The robots of scenarios, with their velocities at the last sample of the context. Without
    /// `simulated` it knows none.
    pub fn new(arm: &NominalArm, simulated: Option<&Simulated>) -> Self {
        let robots = simulated.map(|simulated| {
            let robots = simulated.scenarios.iter().map(|scenario| scenario.robot.clone());
            robots.zip(simulated.velocities.iter().copied()).collect()
        });
        Self { replay: arm.replay(), robots: robots.unwrap_or_default() }
    }
}

impl Predictor for Oracle {
    fn name(&self) -> &'static str {
        wire::ORACLE
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let (joints, last) = (observed.joints(), observed.context() - 1);
        let motions: Vec<Motion<'_>> = (0..observed.robots())
            .zip(&self.robots)
            .map(|(scenario, (robot, velocities))| Motion {
                robot,
                q0: observed.y(scenario)[last].iter().copied().map(f64::from).collect(),
                qd0: *velocities,
                u: &observed.u(scenario).values()[last * joints..],
                anchors: &[],
            })
            .collect();
        let length = (observed.horizon() + 1) * joints;
        let moved = self.replay.run(&motions);
        Ok(moved.chunks_exact(length).flat_map(|motion| &motion[joints..]).copied().collect())
    }

    fn answer(&self, observed: &Observed<'_>, _: usize) -> Result<Answer, EvaluationError> {
        let arms = self.robots.iter().map(|(robot, _)| robot.clone()).collect();
        Ok(Answer { positions: self.predict(observed)?, arms: Some(arms), samples: None })
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use serde_json::json;
    use spec::{DataSpec, JobSpec, SimulateSpec};

    use super::*;

    fn simulated(preset: &str, noise_rad: f64) -> (SimulateSpec, dynamics::Trajectories) {
        let spec = json!({
            "preset": preset, "trajectories": 6, "samples": 60,
            "observations": {
                "joint_velocities": true, "position_noise_rad": noise_rad,
                "position_resolution_rad": 0, "torque_noise_nm": 0,
            },
        });
        let JobSpec::Simulate(spec) = spec::parse(spec.to_string().as_bytes()).unwrap() else {
            panic!("not a simulation")
        };
        let simulated = dynamics::simulate(&spec, 0..6, &|_| ControlFlow::Continue(())).unwrap();
        (spec, simulated)
    }

    fn errors(preset: &str, noise_rad: f64) -> Vec<f64> {
        let (spec, simulated) = simulated(preset, noise_rad);
        let (context, joints) = (20, simulated.series.joints());
        let qd = simulated.qd.as_ref().unwrap();
        let at = |robot: usize| {
            let place = (robot * 60 + context - 1) * joints;
            qd[place..][..joints].iter().copied().map(f64::from).collect()
        };
        let scenarios = simulated.scenarios.clone();
        let velocities = (0..scenarios.len()).map(at).collect();
        let arm = NominalArm::of(&DataSpec::Simulation(spec.clone()));
        let oracle = Oracle::new(&arm, Some(&Simulated { spec, scenarios, velocities }));
        let predicted = oracle.predict(&simulated.series.observed(context)).unwrap();
        let row = 60 * joints;
        let truth = simulated.series.true_y().chunks_exact(row);
        let truth = truth.flat_map(|truth| &truth[context * joints..]);
        predicted.iter().zip(truth).map(|(a, b)| f64::from((a - b).abs())).collect()
    }

    #[test]
    fn it_moves_as_the_robot_does_and_noise_is_all_that_it_does_not_know() {
        let largest = |errors: Vec<f64>| errors.into_iter().fold(0.0, f64::max);
        assert!(largest(errors("D2-mixed", 0.0)) < 2e-4);
        let noisy = largest(errors("D2-mixed", 1e-3));
        assert!((1e-3..0.05).contains(&noisy), "{noisy}");
        // A controller changes its torque within a sample.
        let controlled = largest(errors("panda-real", 0.0));
        assert!((1e-6..0.02).contains(&controlled), "{controlled}");
    }
}
