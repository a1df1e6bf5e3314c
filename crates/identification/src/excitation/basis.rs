//! Motions as vectors of variables, on a grid of times.

use std::f64::consts::TAU;

use dynamics::Joints;
use nalgebra::{DMatrix, DVector};

use super::limits::Limits;
use crate::fourier::{Fourier, FourierJoint, MotionState};

/// Motions that begin and end at rest: with velocity and acceleration 0.
///
/// The variables of a joint are its offset and coordinates of its sines and cosines, in half widths
/// of its positions. At the time 0, the velocity is ∝ Σ k a_k and the acceleration ∝ Σ k² b_k, so
/// coordinates are taken in the spaces in which the sums are 0.
pub(crate) struct Basis {
    base_frequency_hz: f64,
    harmonics: usize,
    middle: Joints<f64>,
    half: Joints<f64>,
    /// Coefficients `[harmonic]` of sines and cosines per variable.
    sines: DMatrix<f64>,
    cosines: DMatrix<f64>,
    /// Positions, velocities and accelerations at the grid's times per variable, `[time, variable]`.
    by_variable: [DMatrix<f64>; 3],
}

impl Basis {
    /// A grid of `times` over one period.
    pub(crate) fn new(
        base_frequency_hz: f64,
        harmonics: usize,
        times: usize,
        limits: &Limits,
    ) -> Self {
        // A harmonic k of the same size moves k times as fast.
        let of_rest = |weight: &dyn Fn(f64) -> f64| {
            let sums = DVector::from_fn(harmonics, |k, _| weight((k + 1) as f64));
            let mut space = orthogonal_to(&sums);
            for k in 0..harmonics {
                space.row_mut(k).scale_mut(1.0 / (k + 1) as f64);
            }
            space
        };
        let (sines, cosines) = (of_rest(&|_| 1.0), of_rest(&|k| k));
        let free = harmonics - 1;
        let wave =
            |time: usize, k: usize| (TAU * ((time * k) % times) as f64 / times as f64).sin_cos();
        let by_variable = [0, 1, 2].map(|order| {
            let of_sine = DMatrix::from_fn(times, harmonics, |time, k| {
                let (sin, cos) = wave(time, k + 1);
                let w = TAU * base_frequency_hz * (k + 1) as f64;
                [sin, w * cos, -w * w * sin][order]
            });
            let of_cosine = DMatrix::from_fn(times, harmonics, |time, k| {
                let (sin, cos) = wave(time, k + 1);
                let w = TAU * base_frequency_hz * (k + 1) as f64;
                [cos, -w * sin, -w * w * cos][order]
            });
            let mut values = DMatrix::zeros(times, 1 + 2 * free);
            values.column_mut(0).fill(if order == 0 { 1.0 } else { 0.0 });
            values.columns_mut(1, free).copy_from(&(of_sine * &sines));
            values.columns_mut(1 + free, free).copy_from(&(of_cosine * &cosines));
            values
        });
        let (middle, half) = (limits.middle, limits.half);
        Self { base_frequency_hz, harmonics, middle, half, sines, cosines, by_variable }
    }

    /// Variables of a joint.
    pub(crate) const fn of_joint(&self) -> usize {
        2 * self.harmonics - 1
    }

    pub(crate) fn variables(&self) -> usize {
        self.of_joint() * self.half.len()
    }

    /// The motion at the grid's times.
    pub(crate) fn states(&self, variables: &DVector<f64>) -> Vec<MotionState> {
        let (of_joint, joints) = (self.of_joint(), self.half.len());
        let by_joint = DMatrix::from_column_slice(of_joint, joints, variables.as_slice());
        let [q, qd, qdd] = self.by_variable.each_ref().map(|values| values * &by_joint);
        let state = |time: usize| MotionState {
            q: Joints::from_fn(joints, |j| self.middle[j] + self.half[j] * q[(time, j)]),
            qd: Joints::from_fn(joints, |j| self.half[j] * qd[(time, j)]),
            qdd: Joints::from_fn(joints, |j| self.half[j] * qdd[(time, j)]),
        };
        (0..q.nrows()).map(state).collect()
    }

    /// The slopes in the variables of a function with these slopes in positions, velocities and
    /// accelerations at the grid's times.
    pub(crate) fn gradient(&self, slopes: &[MotionState]) -> DVector<f64> {
        let joints = self.half.len();
        let pick: [fn(&MotionState) -> &Joints<f64>; 3] =
            [|state| &state.q, |state| &state.qd, |state| &state.qdd];
        let mut gradient = DMatrix::zeros(self.of_joint(), joints);
        for (values, pick) in self.by_variable.iter().zip(pick) {
            let of_order =
                DMatrix::from_fn(slopes.len(), joints, |t, j| self.half[j] * pick(&slopes[t])[j]);
            gradient += values.tr_mul(&of_order);
        }
        DVector::from_column_slice(gradient.as_slice())
    }

    pub(crate) fn motion(&self, variables: &DVector<f64>) -> Fourier {
        let free = self.harmonics - 1;
        let joint = |(joint, half): (usize, &f64)| {
            let own = variables.rows(joint * self.of_joint(), self.of_joint());
            let coefficients = |space: &DMatrix<f64>, begin: usize| -> Vec<f64> {
                let coefficients = space * own.rows(begin, free) * *half;
                coefficients.as_slice().to_vec()
            };
            FourierJoint {
                offset_rad: self.middle[joint] + half * own[0],
                sine_rad: coefficients(&self.sines, 1),
                cosine_rad: coefficients(&self.cosines, 1 + free),
            }
        };
        Fourier {
            base_frequency_hz: self.base_frequency_hz,
            joints: self.half.iter().enumerate().map(joint).collect(),
        }
    }
}

/// An orthonormal basis of the vectors orthogonal to `vector`, as columns (Householder's reflection
/// of `vector` onto the first axis, without its first column).
fn orthogonal_to(vector: &DVector<f64>) -> DMatrix<f64> {
    let size = vector.len();
    let mut normal = vector.normalize();
    normal[0] += normal[0].signum();
    let square = normal.norm_squared();
    let reflection = DMatrix::identity(size, size) - &normal * normal.transpose() * (2.0 / square);
    reflection.columns(1, size - 1).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_are_at_rest_at_both_ends_and_equal_their_grid() {
        let one = Joints::splat(2, 1.0);
        let limits = Limits {
            middle: Joints::from([0.3, -0.2]),
            half: Joints::from([0.5, 2.0]),
            velocity: one,
            acceleration: one,
            torque: one,
            floor_m: None,
        };
        let basis = Basis::new(0.1, 5, 60, &limits);
        let variables = DVector::from_fn(basis.variables(), |k, _| (1.7 * k as f64).sin());
        let motion = basis.motion(&variables);
        for time_s in [0.0, 10.0] {
            let state = motion.at(time_s);
            assert!(state.qd.iter().chain(&state.qdd).all(|value| value.abs() < 1e-12));
        }
        for (time, state) in basis.states(&variables).iter().enumerate() {
            let expected = motion.at(time as f64 / 6.0);
            for j in 0..2 {
                assert!((state.q[j] - expected.q[j]).abs() < 1e-12);
                assert!((state.qd[j] - expected.qd[j]).abs() < 1e-12);
                assert!((state.qdd[j] - expected.qdd[j]).abs() < 1e-11);
            }
        }
    }
}
