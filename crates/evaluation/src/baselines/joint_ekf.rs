//! An extended Kalman filter of an arm's motion and its parameters.

use dynamics::{ArmState, Joints, Motion, Replay, Robot};
use models::Interrupt;
use nalgebra::{Cholesky, DMatrix, DVector};
use series::{MeasurementNoise, Observed, Track};
use spec::Precision;

use super::NominalArm;
use super::constant_velocity::slope_at;
use super::continuation::{Continuation, whole};
use super::end_state::EndState;
use super::filtered::{answer_with_arms, held};
use super::prior::{Freedom, Prior};
use super::rollout::to_f32;
use crate::predictor::Answer;
use crate::{EvaluationError, Predictor};

/// Filters the context once: positions, velocities and the parameters of the arm are one state
/// (Jazwinski 1970, "Stochastic processes and filtering theory", chapter 8). Then it simulates the
/// horizon with the mean arm from the mean state.
///
/// The parameters are those of `identification`, standard normal a priori ([`Prior`]). They stay as they
/// are between measurements. The simulator moves the state from one measurement to the next, [`FILTERED_HZ`] times a second at
/// most. Its derivatives are forward differences: the mean and its neighbours in every number of the
/// state are lanes of one simulation, and so are neighbours in every torque. The measurements are
/// positions with the data's noise, at least [`NOISE_RAD`]. The torques have the data's noise, and at least a
/// share of themselves, which stands for what the simulator is not told.
///
/// If the filter or the simulation of its arm is not finite, the answer is that of the nominal arm. If
/// that is not finite either, the answer is the last position.
#[derive(Clone, Debug)]
pub struct JointEkf {
    prior: Prior,
    /// The simulation of the filter. Its numbers have room for small differences.
    replay: Replay,
    continuation: Continuation,
}

/// Most measurements in a second, Hz.
const FILTERED_HZ: f64 = 30.0;
/// Least standard deviation of a measured position, rad. Encoders are better. With their noise, the first
/// measurements count for more than derivatives at the nominal arm are worth, and the filter becomes too sure of a
/// wrong arm: with 2e-5 rad the error over half a second was three times as large.
const NOISE_RAD: f64 = 3e-4;
/// Least standard deviation of a torque over a sampling period, as a share of the joint's torque (root mean square).
const TORQUE_SHARE: f64 = 0.01;
/// Standard deviation of the velocity at the first sample around the slope of the positions, rad/s.
const VELOCITY_SPREAD: f64 = 0.3;
/// Differences for derivatives: rad, rad/s, standard deviations of a parameter, N·m.
const POSITION_DIFFERENCE: f64 = 1e-5;
const VELOCITY_DIFFERENCE: f64 = 1e-4;
const PARAMETER_DIFFERENCE: f64 = 1e-3;
const TORQUE_DIFFERENCE: f64 = 1e-2;

/// The distribution of the state.
struct Belief {
    state: ArmState,
    /// Standard normal numbers of the arm.
    parameters: DVector<f64>,
    /// The rows and columns of positions come first, then velocities, then parameters.
    covariance: DMatrix<f64>,
}

/// The course of the mean state over the time between two measurements.
struct Course {
    state: ArmState,
    /// By the state: `[position or velocity, number of the state]`.
    transition: DMatrix<f64>,
    /// By the torques: `[position or velocity, joint]`, per N·m.
    driven: DMatrix<f64>,
}

impl JointEkf {
    /// Filters arms that vary like these.
    pub fn new(arm: &NominalArm) -> Self {
        Self {
            prior: Prior::new(&arm.robot, Freedom::Everything),
            replay: Replay { precision: Precision::F64, ..arm.replay() },
            continuation: Continuation::new(arm),
        }
    }

    /// The belief at the last of `positions`. `None` if it is not finite.
    fn filter(
        &self,
        torques: Track<'_>,
        positions: Track<'_>,
        noise: MeasurementNoise,
        interrupt: &Interrupt,
    ) -> Option<Belief> {
        let (joints, last) = (positions.joints(), positions.samples() - 1);
        let rate_hz = self.replay.rate_hz;
        let position_noise = noise.position_rad.max(NOISE_RAD).powi(2);
        let torque_noise = DVector::from_fn(joints, |joint, _| {
            let squares: f64 =
                torques.joint(joint).take(last + 1).map(|u| f64::from(u).powi(2)).sum();
            noise.torque_nm.powi(2) + TORQUE_SHARE.powi(2) * squares / (last + 1) as f64
        });
        let stride = whole(rate_hz / FILTERED_HZ);
        let mut sample = last % stride;
        let mut belief = self.begin(positions, sample, position_noise);
        while sample < last {
            interrupt.leave_if_raised();
            let u = &torques.values()[sample * joints..(sample + stride) * joints];
            let course = self.course(&belief, u);
            let noise = &torque_noise / stride as f64;
            belief.predict(&course, &noise);
            sample += stride;
            let measured: Joints<f64> = positions[sample].iter().copied().map(f64::from).collect();
            belief.update(&measured, position_noise)?;
        }
        Some(belief)
    }

    /// The belief at `sample`, before any torque.
    fn begin(&self, positions: Track<'_>, sample: usize, position_noise: f64) -> Belief {
        let joints = positions.joints();
        let rate_hz = self.replay.rate_hz;
        let state = ArmState {
            q: positions[sample].iter().copied().map(f64::from).collect(),
            qd: Joints::from_fn(joints, |joint| slope_at(positions, sample, joint, rate_hz)),
        };
        let parameters = DVector::zeros(self.prior.parameters());
        let mut variances = DVector::from_element(2 * joints + parameters.len(), 1.0);
        variances.rows_mut(0, joints).fill(position_noise);
        variances.rows_mut(joints, joints).fill(VELOCITY_SPREAD * VELOCITY_SPREAD);
        Belief { state, parameters, covariance: DMatrix::from_diagonal(&variances) }
    }

    /// Moves the mean under the torques `u` `[sample, joint]`, N·m.
    fn course(&self, belief: &Belief, u: &[f32]) -> Course {
        let Belief { state, parameters, .. } = belief;
        let joints = state.q.len();
        let arm_of = |numbers: &DVector<f64>| self.prior.arm_at(numbers.as_slice()).robot;
        let mean = arm_of(parameters);
        let neighbours: Vec<Robot> = (0..parameters.len())
            .map(|place| {
                let mut numbers = parameters.clone();
                numbers[place] += PARAMETER_DIFFERENCE;
                arm_of(&numbers)
            })
            .collect();
        let pushed: Vec<Vec<f32>> = (0..joints).map(|joint| with_more(u, joint, joints)).collect();
        let motion = |robot, state: ArmState, u| Motion {
            robot,
            q0: state.q,
            qd0: state.qd,
            u,
            anchors: &[],
        };
        let moved = |joint: usize| {
            let mut near = *state;
            near.q[joint] += POSITION_DIFFERENCE;
            motion(&mean, near, u)
        };
        let faster = |joint: usize| {
            let mut near = *state;
            near.qd[joint] += VELOCITY_DIFFERENCE;
            motion(&mean, near, u)
        };
        let mut motions = vec![motion(&mean, *state, u)];
        motions.extend((0..joints).map(moved));
        motions.extend((0..joints).map(faster));
        motions.extend(neighbours.iter().map(|robot| motion(robot, *state, u)));
        motions.extend(pushed.iter().map(|u| motion(&mean, *state, u)));
        let (_, ends) = self.replay.run_through(&motions);
        let (center, ends) = (ends[0], &ends[1..]);
        let (of_state, of_torques) = ends.split_at(2 * joints + parameters.len());
        let change = |end: &ArmState, row: usize| {
            if row < joints {
                end.q[row] - center.q[row]
            } else {
                end.qd[row - joints] - center.qd[row - joints]
            }
        };
        let transition = DMatrix::from_fn(2 * joints, of_state.len(), |row, column| {
            let difference = match column {
                column if column < joints => POSITION_DIFFERENCE,
                column if column < 2 * joints => VELOCITY_DIFFERENCE,
                _ => PARAMETER_DIFFERENCE,
            };
            change(&of_state[column], row) / difference
        });
        let driven = DMatrix::from_fn(2 * joints, joints, |row, joint| {
            change(&of_torques[joint], row) / TORQUE_DIFFERENCE
        });
        Course { state: center, transition, driven }
    }

    /// The arm, and positions `[sample, joint]` of the horizon. Without the filter it begins where the
    /// `observed` positions end, from which noise was removed. The filter takes the `measured` ones.
    fn predict_one(
        &self,
        [observed, measured]: [&Observed<'_>; 2],
        scenario: usize,
        interrupt: &Interrupt,
    ) -> (Robot, Vec<f32>) {
        let (torques, positions) = (observed.u(scenario), observed.y(scenario));
        let filtered = self.filter(torques, measured.y(scenario), measured.noise(), interrupt);
        if let Some(Belief { state: ArmState { q, qd }, parameters, .. }) = filtered {
            let robot = self.prior.arm_at(parameters.as_slice()).robot;
            let end = Some(EndState { q, qd });
            let moved = self.continuation.simulate(&robot, torques.values(), positions, end);
            if let Some(moved) = moved {
                return (robot, moved);
            }
        }
        let zeros = vec![0.0; self.prior.parameters()];
        let nominal = self.prior.arm_at(&zeros).robot;
        let moved = self.continuation.simulate(&nominal, torques.values(), positions, None);
        (nominal, moved.unwrap_or_else(|| held(observed, scenario)))
    }
}

/// The torques `u` `[sample, joint]` with more of one joint's.
fn with_more(u: &[f32], joint: usize, joints: usize) -> Vec<f32> {
    let mut more = u.to_vec();
    for torque in more.iter_mut().skip(joint).step_by(joints) {
        *torque += to_f32(TORQUE_DIFFERENCE);
    }
    more
}

impl Belief {
    /// Moves on by a course, in which the torques have these variances, (N·m)².
    fn predict(&mut self, course: &Course, torque_noise: &DVector<f64>) {
        let Course { state, transition, driven } = course;
        let moving = transition.nrows();
        let still = self.covariance.nrows() - moving;
        let of_moving = transition * &self.covariance;
        let noise = driven * DMatrix::from_diagonal(torque_noise) * driven.transpose();
        let own = &of_moving * transition.transpose() + noise;
        let shared = of_moving.columns(moving, still);
        self.covariance.view_mut((0, 0), (moving, moving)).copy_from(&own);
        self.covariance.view_mut((0, moving), (moving, still)).copy_from(&shared);
        self.covariance.view_mut((moving, 0), (still, moving)).copy_from(&shared.transpose());
        self.state = *state;
    }

    /// Takes measured positions with this variance in. `None` if the result is not finite.
    fn update(&mut self, measured: &Joints<f64>, variance: f64) -> Option<()> {
        let joints = measured.len();
        let seen = self.covariance.columns(0, joints).into_owned();
        let expected =
            seen.rows(0, joints) + DMatrix::from_diagonal_element(joints, joints, variance);
        let gain = Cholesky::new(expected)?.solve(&seen.transpose()).transpose();
        let innovation = DVector::from_fn(joints, |joint, _| measured[joint] - self.state.q[joint]);
        let change = &gain * innovation;
        if !change.iter().all(|value| value.is_finite()) {
            return None;
        }
        for joint in 0..joints {
            self.state.q[joint] += change[joint];
            self.state.qd[joint] += change[joints + joint];
        }
        self.parameters += change.rows(2 * joints, self.parameters.len());
        self.covariance -= &gain * seen.transpose();
        // Rounding leaves it a little less than symmetric.
        self.covariance = 0.5 * (&self.covariance + self.covariance.transpose());
        Some(())
    }
}

impl Predictor for JointEkf {
    fn name(&self) -> &'static str {
        "joint-ekf"
    }

    fn predict(&self, observed: &Observed<'_>) -> Result<Vec<f32>, EvaluationError> {
        Ok(self.answer(observed, 1)?.positions)
    }

    fn answer(&self, observed: &Observed<'_>, _: usize) -> Result<Answer, EvaluationError> {
        answer_with_arms(observed, |asked, scenario, interrupt| {
            self.predict_one(asked, scenario, interrupt)
        })
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
        let filtered = mean_error_of(&JointEkf::new(&arm), &scenarios);
        let nominal = mean_error_of(&Identification::nothing(&arm), &scenarios);
        assert!(filtered < 0.25 * nominal, "{filtered}°, nominal {nominal}°");
    }

    #[test]
    fn a_context_that_shows_nothing_has_a_finite_answer() {
        check_finite_answers(&JointEkf::new(&light_arms(1).0));
    }

    #[test]
    fn measured_positions_make_the_filter_surer_of_the_arm_and_torques_less_sure_of_the_motion() {
        let (arm, scenarios) = light_arms(1);
        let filter = JointEkf::new(&arm);
        let observed = scenarios.observed(64);
        let interrupt = Interrupt::default();
        let belief =
            filter.filter(observed.u(0), observed.y(0), observed.noise(), &interrupt).unwrap();
        let variances = belief.covariance.diagonal();
        let of_parameters = &variances.as_slice()[14..];
        assert!(of_parameters.iter().all(|variance| (0.0..=1.0 + 1e-9).contains(variance)));
        assert!(of_parameters.iter().any(|variance| *variance < 0.5));
        let course = filter.course(&belief, &observed.u(0).values()[..14]);
        let mut moved = Belief { covariance: belief.covariance.clone(), ..belief };
        moved.predict(&course, &DVector::from_element(7, 1.0));
        assert!((0..14).all(|place| moved.covariance[(place, place)] > variances[place]));
    }
}
