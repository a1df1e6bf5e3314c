//! The combinations of an arm's numbers that some motion shows.

use dynamics::Joints;
use nalgebra::{DMatrix, DVector};
use random::{ChaCha8Rng, keyed, unit};

use super::limits::Limits;
use crate::arm::{Arm, Prior};
use crate::fourier::MotionState;
use crate::motion::slope_of_bend;
use crate::torques::regressor;

/// Directions in the numbers of an arm, in standard deviations of the prior, that change torques in
/// some state. All other directions change no torque of any motion, so that the prior's uncertainty
/// stays there.
pub(crate) struct BaseParameters {
    /// Torques of a joint per direction: rows of the regression times these, `[value, direction]`.
    pub(crate) of_joints: Vec<DMatrix<f64>>,
}

/// The first part of the keys of random numbers.
pub(crate) const STATES: u64 = 1;

impl BaseParameters {
    /// A rank-revealing decomposition of the torques of random states within the limits.
    pub(crate) fn of(prior: &Prior, limits: &Limits) -> Self {
        const STATES_DRAWN: u64 = 60;
        /// Relative to the largest singular value. Rounding leaves about 1e-15 of a direction that
        /// no torque shows.
        const SINGULAR: f64 = 1e-11;

        let arm = &prior.arm;
        let joints = arm.joints();
        let scale = DMatrix::from_diagonal(&prior.deviations);
        let whitened: Vec<DMatrix<f64>> =
            (0..joints).map(|joint| arm.measured_derivatives(joint) * &scale).collect();

        let size = arm.numbers.len();
        let mut rows = DMatrix::zeros(0, size);
        for number in 0..STATES_DRAWN {
            let state = random_state(limits, number);
            let regressor = regressor_at(arm, &state);
            let mut of_state = DMatrix::zeros(joints, size);
            for (joint, row) in regressor.chunks(regressor.len() / joints).enumerate() {
                // Joints of every size count alike.
                let row = DVector::from_row_slice(row).transpose() / limits.torque[joint];
                of_state.set_row(joint, &(row * &whitened[joint]));
            }
            rows = stacked(&rows, &of_state);
        }
        let decomposed = rows.qr().r().svd(false, true);
        let largest = decomposed.singular_values.max();
        let kept: Vec<usize> = (0..decomposed.singular_values.len())
            .filter(|&k| decomposed.singular_values[k] > SINGULAR * largest)
            .collect();
        let directions = match decomposed.v_t {
            Some(v_t) => v_t.select_rows(&kept).transpose(),
            None => DMatrix::identity(size, size),
        };
        Self { of_joints: whitened.iter().map(|of_joint| of_joint * &directions).collect() }
    }

    pub(crate) fn count(&self) -> usize {
        self.of_joints.first().map_or(0, DMatrix::ncols)
    }
}

/// The torques of all joints in a state, linear in the values of [`Arm::linear`].
pub(crate) fn regressor_at(arm: &Arm, state: &MotionState) -> Vec<f64> {
    let bends_rad_s = arm.bends_rad_s();
    let of_ratios = |torque: fn(f64) -> f64| -> Vec<f64> {
        state.qd.iter().zip(&bends_rad_s).map(|(qd, speed)| torque(qd / speed)).collect()
    };
    regressor(arm, state, [&of_ratios(f64::tanh), &of_ratios(slope_of_bend)])
}

fn random_state(limits: &Limits, number: u64) -> MotionState {
    let mut generator = keyed::<ChaCha8Rng>([STATES, number, 0, 0]);
    let mut within = |middle: &Joints<f64>, half: &Joints<f64>| -> Joints<f64> {
        let mut drawn =
            |(middle, half): (&f64, &f64)| middle + half * (2.0 * unit(&mut generator) - 1.0);
        middle.iter().zip(half).map(&mut drawn).collect()
    };
    let rest = Joints::splat(limits.half.len(), 0.0);
    MotionState {
        q: within(&limits.middle, &limits.half),
        qd: within(&rest, &limits.velocity),
        qdd: within(&rest, &limits.acceleration),
    }
}

fn stacked(above: &DMatrix<f64>, below: &DMatrix<f64>) -> DMatrix<f64> {
    let mut both = DMatrix::zeros(above.nrows() + below.nrows(), below.ncols());
    both.rows_mut(0, above.nrows()).copy_from(above);
    both.rows_mut(above.nrows(), below.nrows()).copy_from(below);
    both
}
