//! The baselines that know the controller.

use dynamics::{Robot, Scenario, simulate_scenarios};
use rayon::prelude::*;
use series::Observed;
use spec::{Observations, SimulateSpec};

use super::Simulated;
use crate::{EvaluationError, Predictor};

/// Simulates an arm under the controller of each scenario, with its law, gains, delay and limits.
///
/// The motion from the last sample of the context on is added to the position that was measured
/// there. Sensors of the controller have no noise here, because nobody knows it ahead. A scenario in
/// which the arm loses its reference has no answer.
#[derive(Clone, Debug)]
pub struct KnownController {
    name: &'static str,
    spec: SimulateSpec,
    scenarios: Vec<Scenario>,
}

impl KnownController {
    /// The nominal arm, with a payload in the middle of its ranges.
    pub fn with_nominal_arm(simulated: &Simulated) -> Self {
        let mut known = Self::new("nominal-simulator", simulated);
        let nominal = Robot::nominal(&known.spec.robot);
        known.scenarios.iter_mut().for_each(|scenario| scenario.robot = nominal.clone());
        known
    }

    /// The robot itself, which nobody has. Its error is what cannot be known.
    pub fn with_robot(simulated: &Simulated) -> Self {
        Self::new(wire::ORACLE, simulated)
    }

    fn new(name: &'static str, simulated: &Simulated) -> Self {
        let mut spec = simulated.spec.clone();
        spec.observations = Observations::default();
        Self { name, spec, scenarios: simulated.scenarios.clone() }
    }

    /// Positions of each scenario, `[sample, joint]`, rad. NaN where there are none.
    fn moved(&self) -> Vec<Vec<f32>> {
        let row = self.spec.samples as usize * self.spec.joints();
        let rows = |q: &[f32]| q.chunks_exact(row).map(<[f32]>::to_vec).collect();
        match simulate_scenarios(&self.spec, &self.scenarios) {
            Ok(all) => rows(all.series.true_y()),
            // One that lost its reference ends the simulation of all.
            Err(_) => {
                let alone = |scenario: &Scenario| {
                    simulate_scenarios(&self.spec, std::slice::from_ref(scenario)).map_or_else(
                        |_| vec![f32::NAN; row],
                        |alone| alone.series.true_y().to_vec(),
                    )
                };
                self.scenarios.par_iter().map(alone).collect()
            }
        }
    }
}

impl Predictor for KnownController {
    fn name(&self) -> &'static str {
        self.name
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        let (joints, last) = (observed.joints(), observed.context() - 1);
        let known = (observed.pre_roll() + observed.context()) * joints;
        let mut predicted = Vec::with_capacity(observed.robots() * observed.horizon() * joints);
        for (scenario, moved) in self.moved().iter().enumerate() {
            let (past, ahead) = moved.split_at(known);
            let start = &past[known - joints..];
            let measured = &observed.y(scenario)[last];
            for q in ahead.chunks_exact(joints).take(observed.horizon()) {
                let from_start = q.iter().zip(start).zip(measured);
                predicted.extend(from_start.map(|((q, start), measured)| measured + (q - start)));
            }
        }
        Ok(predicted)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use dynamics::Joints;
    use serde_json::json;
    use spec::JobSpec;

    use super::*;

    const CONTEXT: usize = 20;

    fn simulated(noise_rad: f64) -> (Simulated, dynamics::Trajectories) {
        let spec = json!({
            "preset": "panda-real", "trajectories": 6, "samples": 60,
            "observations": {
                "position_noise_rad": noise_rad, "position_resolution_rad": 0, "torque_noise_nm": 0,
            },
        });
        let JobSpec::Simulate(spec) = spec::parse(spec.to_string().as_bytes()).unwrap() else {
            panic!("not a simulation")
        };
        let found = dynamics::simulate(&spec, 0..6, &|_| ControlFlow::Continue(())).unwrap();
        let scenarios = found.scenarios.clone();
        let velocities = vec![Joints::from_fn(7, |_| 0.0); 6];
        (Simulated { spec, scenarios, velocities }, found)
    }

    fn largest_error(predictor: &KnownController, found: &dynamics::Trajectories) -> f32 {
        let predicted = predictor.predict(&found.series.observed(CONTEXT)).unwrap();
        let truth = found.series.true_y().chunks_exact(60 * 7);
        let truth = truth.flat_map(|truth| &truth[CONTEXT * 7..]);
        predicted.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn the_robot_moves_as_it_did_and_the_nominal_arm_follows_nearly_as_well() {
        let (known, found) = simulated(0.0);
        let itself = largest_error(&KnownController::with_robot(&known), &found);
        let nominal = largest_error(&KnownController::with_nominal_arm(&known), &found);
        assert!(itself < 1e-5, "{itself}");
        assert!((0.001..0.2).contains(&nominal), "{nominal}");
        let (known, found) = simulated(1e-4);
        let itself = largest_error(&KnownController::with_robot(&known), &found);
        assert!((1e-4..3e-3).contains(&itself), "{itself}");
    }

    #[test]
    fn a_scenario_that_loses_its_reference_has_no_answer_and_the_others_have_theirs() {
        let (mut known, found) = simulated(0.0);
        let heavy = &mut known.scenarios[2].robot;
        heavy.links.iter_mut().for_each(|link| link.mass *= 50.0);
        let predictor = KnownController::with_robot(&known);
        let predicted = predictor.predict(&found.series.observed(CONTEXT)).unwrap();
        for (scenario, predicted) in predicted.chunks_exact(40 * 7).enumerate() {
            assert_eq!(predicted.iter().all(|q| q.is_finite()), scenario != 2, "{scenario}");
        }
    }
}
