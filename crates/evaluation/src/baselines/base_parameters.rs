//! Base-parameter least squares: a description of the arm and a page of linear algebra.

use dynamics::{Joints, Robot, mass_matrix};
use models::Interrupt;
use nalgebra::DMatrix;
use rayon::prelude::*;
use series::{JointMotion, Observed, Track, mean_torques};

use super::NominalArm;
use super::continuation::Continuation;
use super::end_state::end_state;
use super::filtered::{answer_with_arms, held, smoothed};
use super::linear_arm::{FittedArm, LinearArm, Record};
use super::rollout::to_f32;
use crate::metrics::torques_of_arm;
use crate::predictor::Answer;
use crate::{EvaluationError, Predictor};

/// Fits the parameters in which torques are linear to the torques of each context, by ridge
/// regression (Atkeson, An and Hollerbach 1986, "Estimation of inertial parameters of manipulator
/// loads and links"). Then it simulates the horizon.
///
/// The parameters are ten of each link, and the damping, the friction, the armature and the torque
/// offset of each joint ([`LinearArm`]). The ridge pulls them to the nominal arm's, with a spread in
/// proportion to the nominal size. It does not know how the data's robots vary. Combinations that the
/// motion does not show stay nominal, and the base parameters, those that torques depend on, follow the data (Gautier and Khalil 1990, "Direct
/// calculation of minimum set of inertial parameters of serial robots").
///
/// Velocities and accelerations are central differences of the smoothed positions, and the torques have the same weights ([`JointMotion::measured`]).
/// Lengths are the nominal arm's. A lightly damped arm starts at [`end_state`], as `identification` does.
///
/// A fitted arm whose mass matrix is hardly positive definite along the context gets as much more armature as it lacks
/// ([`LEAST_INERTIA`]) before it is simulated. If its simulation is not finite, the answer is that of
/// the nominal arm. If that is not finite either, the answer is the last position.
#[derive(Clone, Debug)]
pub struct BaseParameters {
    arm: LinearArm,
    continuation: Continuation,
}

/// Poses of the context at which the mass matrix is checked.
const CHECKED_POSES: usize = 32;
/// Least eigenvalue of a mass matrix, as a share of the nominal arm's in the same pose.
const LEAST_INERTIA: f64 = 0.2;

impl BaseParameters {
    /// Fits arms like this one.
    pub fn new(arm: &NominalArm) -> Self {
        Self {
            arm: LinearArm::new(Robot::nominal(&arm.robot)),
            continuation: Continuation::new(arm),
        }
    }

    /// The arm that explains the context's torques, N·m, along its `positions`, rad. `None` if the
    /// context is too short.
    fn fit(&self, torques: &[f32], positions: Track<'_>, rate_hz: f64) -> Option<FittedArm> {
        let (joints, known) = (positions.joints(), positions.values().len());
        let motion = JointMotion::measured(positions.values(), joints, rate_hz);
        let torques = mean_torques(&torques[..known], joints, rate_hz);
        let record = Record { motion: &motion, torques: &torques, rate_hz };
        self.arm.fit(&record)
    }

    /// The robot with enough armature for the poses in `positions`.
    fn movable(&self, robot: Robot, positions: Track<'_>) -> Robot {
        let stride = positions.samples().div_ceil(CHECKED_POSES).max(1);
        let lacking = |q: &[f32]| {
            let q: Joints<f64> = q.iter().copied().map(f64::from).collect();
            LEAST_INERTIA * least_inertia(self.arm.nominal(), q) - least_inertia(&robot, q)
        };
        let lacks = positions.iter().step_by(stride).map(lacking).fold(0.0, f64::max);
        Robot { armature: robot.armature.map(|armature| armature + lacks), ..robot }
    }

    /// The arm, and positions `[sample, joint]` of the horizon. It is fitted to the `observed`
    /// positions, from which noise was removed, and begins where the `measured` ones end.
    fn predict_one(
        &self,
        [observed, measured]: [&Observed<'_>; 2],
        scenario: usize,
    ) -> (Robot, Vec<f32>) {
        let (torques, positions) = (observed.u(scenario).values(), observed.y(scenario));
        let (joints, rate_hz) = (observed.joints(), observed.rate_hz());
        if let Some(fitted) = self.fit(torques, positions, rate_hz) {
            let FittedArm { robot, offset_nm } = fitted;
            let robot = self.movable(robot, positions);
            let felt: Vec<f32> = torques
                .chunks_exact(joints)
                .flat_map(|u| u.iter().zip(&offset_nm).map(|(u, offset)| u - to_f32(*offset)))
                .collect();
            let end = if self.continuation.forgets {
                None
            } else {
                let felt = Track::new(&felt, joints);
                end_state(&robot, felt, measured.y(scenario), rate_hz, measured.noise())
            };
            if let Some(moved) = self.continuation.simulate(&robot, &felt, positions, end) {
                return (robot, moved);
            }
        }
        let nominal = self.arm.nominal();
        let moved = self.continuation.simulate(nominal, torques, positions, None);
        (nominal.clone(), moved.unwrap_or_else(|| held(observed, scenario)))
    }
}

/// The least eigenvalue of the mass matrix at `q`, kg m².
fn least_inertia(robot: &Robot, q: Joints<f64>) -> f64 {
    let joints = robot.joints();
    let mass = mass_matrix(robot, q);
    DMatrix::from_fn(joints, joints, |row, column| mass[row][column]).symmetric_eigenvalues().min()
}

impl Predictor for BaseParameters {
    fn name(&self) -> &'static str {
        "base-parameters"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(self.answer(observed, 1)?.positions)
    }

    fn answer(&self, observed: &Observed<'_>, _: usize) -> Result<Answer, EvaluationError> {
        answer_with_arms(observed, |asked, scenario, _| self.predict_one(asked, scenario))
    }

    /// The torques of the fitted arms with their offsets. An answer has no offsets and perhaps more
    /// armature, so the arms are fitted again.
    fn torques(
        &self,
        observed: &Observed<'_>,
        answer: &Answer,
        motions: &[JointMotion],
    ) -> Result<Option<Vec<Vec<f64>>>, EvaluationError> {
        let Some(arms) = &answer.arms else { return Ok(None) };
        let interrupt = Interrupt::current();
        let smoothed = smoothed(observed)?;
        let smoothed = smoothed.as_ref().map(|series| series.observed(observed.context()));
        let observed = smoothed.as_ref().unwrap_or(observed);
        let of_robot = |(scenario, (arm, motion)): (usize, (&Robot, &JointMotion))| {
            interrupt.leave_if_raised();
            let (u, y) = (observed.u(scenario).values(), observed.y(scenario));
            let Some(fitted) = self.fit(u, y, observed.rate_hz()) else {
                return torques_of_arm(arm, motion);
            };
            let mut torques = torques_of_arm(&fitted.robot, motion);
            for torques in torques.chunks_exact_mut(arm.joints()) {
                let each = torques.iter_mut().zip(&fitted.offset_nm);
                each.for_each(|(torque, offset)| *torque += offset);
            }
            torques
        };
        let robots = arms.par_iter().zip(motions).enumerate();
        Ok(Some(robots.map(of_robot).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Identification;
    use crate::baselines::fixture::{check_finite_answers, light_arms, mean_error_of};

    #[test]
    fn a_light_arm_with_a_load_is_predicted_much_better_than_the_nominal_one() {
        let (arm, scenarios) = light_arms(8);
        let fitted = mean_error_of(&BaseParameters::new(&arm), &scenarios);
        let nominal = mean_error_of(&Identification::nothing(&arm), &scenarios);
        assert!(fitted < 0.25 * nominal, "{fitted}°, nominal {nominal}°");
    }

    #[test]
    fn an_arm_with_too_little_inertia_gets_as_much_armature_as_it_lacks() {
        let (arm, scenarios) = light_arms(1);
        let fit = BaseParameters::new(&arm);
        let observed = scenarios.observed(320);
        let nominal = fit.arm.nominal();
        let poses = || observed.y(0).iter().step_by(10);
        let least = |robot: &Robot| {
            let of_pose = |q: &[f32]| {
                let q: Joints<f64> = q.iter().copied().map(f64::from).collect();
                least_inertia(robot, q) / least_inertia(nominal, q)
            };
            poses().map(of_pose).fold(f64::INFINITY, f64::min)
        };
        let armature = nominal.armature.map(|armature| armature - 0.5);
        let impossible = Robot { armature, ..nominal.clone() };
        assert!(least(&impossible) < 0.0);
        let movable = least(&fit.movable(impossible, observed.y(0)));
        assert!((movable - LEAST_INERTIA).abs() < 1e-6, "{movable}");
        assert_eq!(fit.movable(nominal.clone(), observed.y(0)), *nominal);
    }

    #[test]
    fn a_context_that_shows_nothing_has_a_finite_answer() {
        check_finite_answers(&BaseParameters::new(&light_arms(1).0));
    }

    #[test]
    fn the_torques_of_a_motion_are_those_of_the_fitted_arm_and_its_offset() {
        let (arm, scenarios) = light_arms(4);
        let error = |predictor: &dyn Predictor| {
            let observed = scenarios.observed(320);
            let answer = predictor.answer(&observed, 1).unwrap();
            let joints = observed.joints();
            let view = scenarios.view();
            let horizon = |values: &[f32]| values[320 * joints..].to_vec();
            let motions: Vec<JointMotion> = (0..4)
                .map(|robot| {
                    let positions = horizon(view.true_y(robot).values());
                    JointMotion::measured(&positions, joints, observed.rate_hz())
                })
                .collect();
            let said = predictor.torques(&observed, &answer, &motions).unwrap().unwrap();
            let squares = said.iter().enumerate().map(|(robot, said)| {
                let acted =
                    mean_torques(&horizon(view.u(robot).values()), joints, observed.rate_hz());
                let squares = said.iter().zip(&acted).map(|(said, acted)| (said - acted).powi(2));
                squares.sum::<f64>() / said.len() as f64
            });
            (squares.sum::<f64>() / 4.0).sqrt()
        };
        let fitted = error(&BaseParameters::new(&arm));
        let nominal = error(&Identification::nothing(&arm));
        assert!(fitted < 0.2 * nominal, "{fitted} N·m, nominal {nominal} N·m");
    }
}
