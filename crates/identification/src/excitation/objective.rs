//! How much a motion shows of an arm, and its distance from the limits.
//!
//! The objective is log det(1 + W) with the information W of the base parameters in standard
//! deviations of the prior, plus a barrier: the mean over the grid's times of the logarithms of the
//! distances from the limits. Slopes follow backwards: those of log det(1 + W) in the entries of the
//! regression are linear in its rows, and the rows' own slopes in the state are differences. The bends of
//! Coulomb friction count as known: a motion that shows them stands still for most of its time.

use dynamics::{Joints, LINK_PARAMETERS, torque_regressor};
use nalgebra::{DMatrix, DVector};

use super::base_parameters::{BaseParameters, regressor_at};
use super::basis::Basis;
use super::limits::{Limits, heights};
use crate::arm::{Arm, NUMBERS, OWN};
use crate::fourier::MotionState;

pub(crate) struct Objective<'a> {
    pub(crate) arm: &'a Arm,
    pub(crate) basis: &'a Basis,
    pub(crate) base: &'a BaseParameters,
    pub(crate) limits: &'a Limits,
    /// The information of a torque of each joint at a time of the grid, 1/(N·m)².
    pub(crate) weights: &'a [f64],
    /// The values of [`Arm::linear`].
    pub(crate) linear: &'a DVector<f64>,
}

/// A motion at the grid's times.
struct Course {
    states: Vec<MotionState>,
    /// Rows of the regression, transposed: `[joint]`, `[value, time]`.
    rows: Vec<DMatrix<f64>>,
    /// Torques but for Coulomb friction, `[time]`, N·m.
    torques: Vec<Joints<f64>>,
    /// Heights over the floor, `[time]`, m.
    over_floor: Vec<Vec<f64>>,
}

/// The information of the base parameters, with the prior's: 1 + W.
struct Information {
    /// Rows per direction, transposed: `[joint]`, `[direction, time]`.
    rows: Vec<DMatrix<f64>>,
    matrix: DMatrix<f64>,
}

/// A step of differences of states, rad, rad/s, rad/s².
const STEP: f64 = 1e-6;

impl Objective<'_> {
    /// log det(1 + W). `None` if the motion leaves the limits.
    pub(crate) fn information(&self, variables: &DVector<f64>) -> Option<f64> {
        let course = self.course(self.basis.states(variables))?;
        log_det(&self.informed(&course).matrix).map(|(value, _)| value)
    }

    /// The objective with a barrier of this weight. `None` if the motion leaves the limits.
    pub(crate) fn value(&self, variables: &DVector<f64>, barrier: f64) -> Option<f64> {
        let course = self.course(self.basis.states(variables))?;
        let (information, _) = log_det(&self.informed(&course).matrix)?;
        Some(information + barrier * self.distance(&course))
    }

    /// Whether the motion stays within the limits.
    pub(crate) fn is_allowed(&self, states: Vec<MotionState>) -> bool {
        states.into_iter().all(|state| self.course(vec![state]).is_some())
    }

    /// The objective and its slopes in the variables. `None` if the motion leaves the limits.
    pub(crate) fn slopes(
        &self,
        variables: &DVector<f64>,
        barrier: f64,
    ) -> Option<(f64, DVector<f64>)> {
        let course = self.course(self.basis.states(variables))?;
        let information = self.informed(&course);
        let (value, inverse) = log_det(&information.matrix)?;
        let value = value + barrier * self.distance(&course);

        let times = course.states.len();
        let share = barrier / times as f64;
        let mut slopes = self.slopes_of_distance(&course, share);
        let of_rows: Vec<DMatrix<f64>> = (0..self.arm.joints())
            .map(|joint| {
                let weighted = &inverse * &information.rows[joint] * (2.0 * self.weights[joint]);
                let mut of_rows = &self.base.of_joints[joint] * weighted;
                for time in 0..times {
                    let slope =
                        slope_of_log(course.torques[time][joint], self.limits.torque[joint]);
                    let without_coulomb = self.linear_without_coulomb(joint) * (share * slope);
                    let mut of_time = of_rows.column_mut(time);
                    of_time += without_coulomb;
                }
                of_rows
            })
            .collect();
        for (time, slopes) in slopes.iter_mut().enumerate() {
            self.add_slopes_of_rows(&course.states[time], &of_rows, time, slopes);
        }
        Some((value, self.basis.gradient(&slopes)))
    }

    /// `None` as soon as a limit is not kept.
    fn course(&self, states: Vec<MotionState>) -> Option<Course> {
        let joints = self.arm.joints();
        let width = joints * NUMBERS;
        let limits = self.limits;
        let is_within = |state: &MotionState| {
            (0..joints).all(|j| {
                (state.q[j] - limits.middle[j]).abs() < limits.half[j]
                    && state.qd[j].abs() < limits.velocity[j]
                    && state.qdd[j].abs() < limits.acceleration[j]
            })
        };
        if !states.iter().all(is_within) {
            return None;
        }
        let over_floor = match limits.floor_m {
            None => Vec::new(),
            Some(floor_m) => {
                let over_floor = |state: &MotionState| {
                    let mut over_floor = Vec::new();
                    heights(&self.arm.nominal().kinematics, &state.q, &mut over_floor);
                    over_floor.iter_mut().for_each(|height| *height -= floor_m);
                    over_floor
                };
                states.iter().map(over_floor).collect()
            }
        };
        if over_floor.iter().flatten().any(|height| *height <= 0.0) {
            return None;
        }
        let mut rows = vec![DMatrix::zeros(width, states.len()); joints];
        let mut torques = Vec::with_capacity(states.len());
        for (time, state) in states.iter().enumerate() {
            let regressor = regressor_at(self.arm, state);
            let mut torque = Joints::splat(joints, 0.0);
            for (joint, row) in regressor.chunks(width).enumerate() {
                let all: f64 = row.iter().zip(self.linear.iter()).map(|(y, value)| y * value).sum();
                let own = joint * NUMBERS + OWN;
                torque[joint] = all - self.linear[own] * row[own];
                rows[joint].column_mut(time).copy_from_slice(row);
            }
            if (0..joints).any(|joint| torque[joint].abs() >= limits.torque[joint]) {
                return None;
            }
            torques.push(torque);
        }
        Some(Course { states, rows, torques, over_floor })
    }

    fn informed(&self, course: &Course) -> Information {
        let size = self.base.count();
        let mut matrix = DMatrix::identity(size, size);
        let mut rows = Vec::with_capacity(course.rows.len());
        for (joint, of_joint) in course.rows.iter().enumerate() {
            let seen = self.base.of_joints[joint].tr_mul(of_joint);
            matrix.gemm(self.weights[joint], &seen, &seen.transpose(), 1.0);
            rows.push(seen);
        }
        Information { rows, matrix }
    }

    /// The mean over times of Σ log(1 − share²) over limits, and of the logarithms of heights.
    fn distance(&self, course: &Course) -> f64 {
        let limits = self.limits;
        let log = |value: f64, limit: f64| (1.0 - (value / limit).powi(2)).ln();
        let mut sum = 0.0;
        for (state, torques) in course.states.iter().zip(&course.torques) {
            for j in 0..torques.len() {
                sum += log(state.q[j] - limits.middle[j], limits.half[j])
                    + log(state.qd[j], limits.velocity[j])
                    + log(state.qdd[j], limits.acceleration[j])
                    + log(torques[j], limits.torque[j]);
            }
        }
        sum += course.over_floor.iter().flatten().map(|height| height.ln()).sum::<f64>();
        sum / course.states.len() as f64
    }

    /// The slopes of [`Objective::distance`] times `share` and the number of times, but for those
    /// through torques.
    fn slopes_of_distance(&self, course: &Course, share: f64) -> Vec<MotionState> {
        let limits = self.limits;
        let kinematics = &self.arm.nominal().kinematics;
        let mut moved = Vec::new();
        let mut of_state = |(time, state): (usize, &MotionState)| {
            let slope = |(value, limit): (&f64, &f64)| share * slope_of_log(*value, *limit);
            let from_middle: Joints<f64> =
                state.q.iter().zip(&limits.middle).map(|(q, middle)| q - middle).collect();
            let mut slopes = MotionState {
                q: from_middle.iter().zip(&limits.half).map(slope).collect(),
                qd: state.qd.iter().zip(&limits.velocity).map(slope).collect(),
                qdd: state.qdd.iter().zip(&limits.acceleration).map(slope).collect(),
            };
            if let (Some(over_floor), Some(floor_m)) = (course.over_floor.get(time), limits.floor_m)
            {
                for joint in 0..state.q.len() {
                    let mut q = state.q;
                    q[joint] += STEP;
                    heights(kinematics, &q, &mut moved);
                    let changes = moved.iter().zip(over_floor);
                    let slope: f64 =
                        changes.map(|(moved, height)| (moved - floor_m - height) / height).sum();
                    slopes.q[joint] += share * slope / STEP;
                }
            }
            slopes
        };
        course.states.iter().enumerate().map(&mut of_state).collect()
    }

    /// Adds the slopes in a state of Σ rows · `of_rows`.
    fn add_slopes_of_rows(
        &self,
        state: &MotionState,
        of_rows: &[DMatrix<f64>],
        time: usize,
        slopes: &mut MotionState,
    ) {
        let joints = self.arm.joints();
        let robot = self.arm.nominal();
        let mut of_links = Vec::with_capacity(joints * joints * LINK_PARAMETERS);
        for of_joint in of_rows {
            let of_time = of_joint.column(time);
            for link in 0..joints {
                of_links
                    .extend_from_slice(&of_time.as_slice()[link * NUMBERS..][..LINK_PARAMETERS]);
            }
        }
        let mut links = vec![0.0; of_links.len()];
        let mut sum = |MotionState { q, qd, qdd }: &MotionState| -> f64 {
            torque_regressor(&robot.kinematics, robot.gravity, q, qd, qdd, &mut links);
            links.iter().zip(&of_links).map(|(row, slope)| row * slope).sum()
        };
        let here = sum(state);
        let bends_rad_s = self.arm.bends_rad_s();
        for (joint, of_joint) in of_rows.iter().enumerate() {
            let mut slope = |pick: fn(&mut MotionState) -> &mut Joints<f64>| {
                let mut moved = *state;
                pick(&mut moved)[joint] += STEP;
                (sum(&moved) - here) / STEP
            };
            let [of_q, of_qd, of_qdd]: [f64; 3] = [
                slope(|state| &mut state.q),
                slope(|state| &mut state.qd),
                slope(|state| &mut state.qdd),
            ];
            let of_row = of_joint.column(time);
            let own = &of_row.as_slice()[joint * NUMBERS + OWN..];
            let bend = (state.qd[joint] / bends_rad_s[joint]).tanh();
            let of_coulomb = (1.0 - bend * bend) / bends_rad_s[joint];
            slopes.q[joint] += of_q;
            slopes.qd[joint] += of_qd + own[0] * of_coulomb + own[1];
            slopes.qdd[joint] += of_qdd + own[3];
        }
    }

    fn linear_without_coulomb(&self, joint: usize) -> DVector<f64> {
        let mut linear = self.linear.clone();
        linear[joint * NUMBERS + OWN] = 0.0;
        linear
    }
}

/// The slope of log(1 − (value / limit)²).
fn slope_of_log(value: f64, limit: f64) -> f64 {
    let share = value / limit;
    -2.0 * share / (limit * (1.0 - share * share))
}

/// The logarithm of the determinant of a positive definite matrix, and its inverse.
fn log_det(matrix: &DMatrix<f64>) -> Option<(f64, DMatrix<f64>)> {
    let factor = matrix.clone().cholesky()?;
    let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum::<f64>();
    Some((log_det, factor.inverse()))
}

#[cfg(test)]
mod tests {
    use spec::RobotModel;

    use super::*;
    use crate::ExcitationSettings;
    use crate::arm::Prior;

    #[test]
    fn slopes_are_those_of_differences() {
        let description = RobotModel::panda().description().clone();
        let settings =
            ExcitationSettings { table_z_m: Some(-1.0), ..ExcitationSettings::default() };
        // Friction that bends within a grid's steps has no slopes that differences can find.
        let bends_rad_s = vec![0.5; description.joints.len()];
        let prior = Prior::of(&description, &bends_rad_s, 0.1).unwrap().with_known_bends();
        let limits = Limits::of(&description, &prior.arm, &settings).unwrap();
        let basis = Basis::new(0.1, 3, 48, &limits);
        let base = BaseParameters::of(&prior, &limits);
        let objective = Objective {
            arm: &prior.arm,
            basis: &basis,
            base: &base,
            limits: &limits,
            weights: &[2.0; 7],
            linear: &prior.arm.linear(),
        };
        let variables =
            DVector::from_fn(basis.variables(), |k, _| 0.05 * (2.3 * k as f64 + 0.4).sin());
        let (value, slopes) = objective.slopes(&variables, 2.0).unwrap();
        assert_eq!(objective.value(&variables, 2.0), Some(value));
        for variable in 0..variables.len() {
            let moved = |by: f64| {
                let mut moved = variables.clone();
                moved[variable] += by;
                objective.value(&moved, 2.0).unwrap()
            };
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            let error = (slopes[variable] - slope).abs();
            assert!(error < 1e-3 * (1.0 + slope.abs()), "{variable}: {} {slope}", slopes[variable]);
        }
    }
}
