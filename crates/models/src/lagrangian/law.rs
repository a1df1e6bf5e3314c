//! A trained law in the form that predicts.
//!
//! The processor computes everything in the lanes of its vectors: many samples at once while a
//! robot is fitted ([`super::fitting`]), and many robots at once while they move
//! ([`super::rollout`]). Lanes of every width give the same bits.

use simd::Lanes;

use super::kinematics::Kinematics;
use super::linear_algebra::{Dense, tanh};
use super::regression::{Numbers, Prior};

/// The unit of learned forces, N·m.
pub(super) const FORCE_UNIT: f32 = 10.0;

/// Directions in which a particle can move.
pub(super) const DIRECTIONS: usize = 3;

/// The least pivot of a mass matrix, as a ratio to the inertia of the joint alone. Masses of 0 or
/// more keep it at 1, up to rounding.
pub(super) const LEAST_PIVOT: f32 = 0.99;

/// A trained law.
#[derive(Debug)]
pub(super) struct Law {
    pub places: Places,
    pub joints: Vec<JointLaw>,
    pub prior: Prior,
    pub calibration: Calibration,
    pub numbers: Numbers,
    /// Whether residual torques go on over the horizon ([`super::disturbance`]).
    pub disturbance: bool,
    /// The number of independent samples that a context counts as. The law's errors at neighbouring
    /// samples are alike. Training uses this many samples and takes their errors as independent.
    pub points: usize,
}

impl Law {
    /// The numbers with the weights of particles in the place of moments, where the arm is told.
    pub fn weighed(&self, numbers: &[f32]) -> Vec<f32> {
        let mut weighed = numbers.to_vec();
        if let Places::Known(kinematics) = &self.places {
            kinematics.weigh(&mut weighed[self.numbers.weights()]);
        }
        weighed
    }
}

/// How the arm moves its particles.
#[derive(Debug)]
pub(super) enum Places {
    Learned(Network),
    Known(Kinematics),
}

/// A network that sees the pose.
#[derive(Debug)]
pub(super) struct Network {
    pub hidden: Vec<Dense>,
    /// Gives `[direction, particle, joint]`.
    pub particles: Dense,
    /// Gives `[1 + force, joint]`.
    pub forces: Option<Dense>,
    /// The first joint whose angle the network sees.
    pub first: usize,
}

/// The constants of a joint, alike on every robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct JointLaw {
    /// The share of the newer one in the torque and the velocity between two values, 0 to 1.
    pub share: f32,
    /// Inertia that no pose changes, kg m².
    pub armature: f32,
    /// Standard deviation of the residual torque at a sample, N·m.
    pub noise: f32,
    /// Slope of the shape of friction where it is steepest, s/rad.
    pub friction_slope: f32,
    /// The velocity at which friction is steepest, negated, rad/s.
    pub friction_shift: f32,
    /// Where a prediction stays.
    pub limits: Limits,
}

/// Limits of a joint's motion, where a prediction stays unless it begins beyond them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Least and largest position, rad.
    pub position: [f32; 2],
    /// Largest speed, rad/s.
    pub speed: f32,
}

impl Limits {
    /// Those of an arm that the law is not told: a speed ten times that of arms. In a motion that the
    /// law does not know, products of velocities could otherwise grow without end.
    pub const UNKNOWN: Self = Self { position: [-f32::MAX, f32::MAX], speed: 50.0 };
}

impl JointLaw {
    /// Friction of strength 1 at a velocity in rad/s, and its slope, in lanes.
    #[inline(always)]
    pub fn friction<L: Lanes>(&self, velocity: L) -> [L; 2] {
        let slope = L::splat(f64::from(self.friction_slope));
        let shift = L::splat(f64::from(self.friction_shift));
        let value = tanh((velocity + shift) * slope);
        let shape = value - tanh(shift * slope);
        [shape, slope * value.neg_mul_add(value, L::splat(1.0))]
    }
}

/// The calibration of draws: how far robots are from the most likely one, in standard deviations of
/// the posterior. This scale is log-normal over robots.
#[derive(Clone, Copy, Debug)]
pub(super) struct Calibration {
    /// Logarithm of the scale's median.
    pub log_median: f32,
    /// Standard deviation of the scale's logarithm.
    pub log_spread: f32,
    /// Logarithm of the share of the residual torque that a draw of scale 1 adds.
    pub log_torque: f32,
}

impl Calibration {
    /// The scale of a robot with the standard normal number `normal`.
    pub fn scale(self, normal: f32) -> f32 {
        self.log_spread.mul_add(normal, self.log_median).exp()
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
pub(super) fn narrow(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}
