//! Periodic motions as sums of sines and cosines.

use std::f64::consts::TAU;

use dynamics::Joints;
use serde::Serialize;

/// A joint's part of a [`Fourier`] motion. Coefficient `k` (from 0) belongs to harmonic `k` + 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FourierJoint {
    /// The mean position, rad.
    pub offset_rad: f64,
    /// Coefficients of the sines, rad.
    pub sine_rad: Vec<f64>,
    /// Coefficients of the cosines, rad.
    pub cosine_rad: Vec<f64>,
}

/// A periodic motion of an arm:
/// q_j(t) = offset + Σ_k sine_k sin(2π k f t) + cosine_k cos(2π k f t), k from 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fourier {
    /// The base frequency f, Hz.
    pub base_frequency_hz: f64,
    /// From the base outwards.
    pub joints: Vec<FourierJoint>,
}

/// Positions, velocities and accelerations of all joints: rad, rad/s, rad/s².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionState {
    /// Positions, rad.
    pub q: Joints<f64>,
    /// Velocities, rad/s.
    pub qd: Joints<f64>,
    /// Accelerations, rad/s².
    pub qdd: Joints<f64>,
}

impl Fourier {
    /// The motion at a time in s.
    pub fn at(&self, time_s: f64) -> MotionState {
        let count = self.joints.len();
        let zero = Joints::splat(count, 0.0);
        let mut state = MotionState { q: zero, qd: zero, qdd: zero };
        let harmonics = self.joints.first().map_or(0, |joint| joint.sine_rad.len());
        for (joint, of_joint) in self.joints.iter().enumerate() {
            state.q[joint] = of_joint.offset_rad;
        }
        for k in 0..harmonics {
            let w = TAU * self.base_frequency_hz * (k + 1) as f64;
            // A whole number of turns is taken off before the sine, so that motions end where they
            // begin.
            let turns = self.base_frequency_hz * time_s * (k + 1) as f64;
            let (sin, cos) = (TAU * turns.fract()).sin_cos();
            for (joint, FourierJoint { sine_rad, cosine_rad, .. }) in self.joints.iter().enumerate()
            {
                let (a, b) = (sine_rad[k], cosine_rad[k]);
                let value = a * sin + b * cos;
                state.q[joint] += value;
                state.qd[joint] += w * (a * cos - b * sin);
                state.qdd[joint] -= w * w * value;
            }
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_and_accelerations_are_slopes_and_a_period_ends_where_it_began() {
        let joint = |offset_rad: f64| FourierJoint {
            offset_rad,
            sine_rad: vec![0.3, -0.2, 0.05],
            cosine_rad: vec![-0.1, 0.15, 0.02],
        };
        let motion = Fourier { base_frequency_hz: 0.05, joints: vec![joint(0.2), joint(-1.0)] };
        let step = 1e-4;
        for k in 0..50 {
            let t = 0.4 * f64::from(k);
            let (before, at, after) = (motion.at(t - step), motion.at(t), motion.at(t + step));
            for j in 0..2 {
                let slope = (after.q[j] - before.q[j]) / (2.0 * step);
                assert!((slope - at.qd[j]).abs() < 1e-7);
                let bend = (after.qd[j] - before.qd[j]) / (2.0 * step);
                assert!((bend - at.qdd[j]).abs() < 1e-7);
            }
        }
        let (start, end) = (motion.at(0.0), motion.at(20.0));
        assert!((start.q[1] - end.q[1]).abs() < 1e-12 && (start.qd[0] - end.qd[0]).abs() < 1e-12);
    }
}
