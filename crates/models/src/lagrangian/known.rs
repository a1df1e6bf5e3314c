//! The most likely robot given a context, and draws of other robots that the context allows.
//!
//! The numbers of a robot are normal given its context ([`super::regression`]), if the law is exact
//! and its errors at [`Law::points`] samples are independent. Both hold only nearly. So a draw also
//! adds residual torques of the law ([`LeftOver`]). Training learns how much more its robots
//! differ, and how much that itself varies from robot to robot ([`Doubt`]).

use nalgebra::{Cholesky, DMatrix, DVector};
use simd::InstructionSet;

use super::law::{Law, narrow};
use super::leftover::{self, LeftOver};
use super::motion::Recorded;
use super::numbers::Bounds;
use super::regression::Posterior;

/// Times that a draw is moved half-way to the most likely robot.
const HALVINGS: usize = 6;

/// A robot at the end of its context.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// Positions at the last two samples, `[sample, joint]`, rad, or at the only one.
    pub y: Vec<f32>,
    /// In the order of [`super::numbers::Numbers`].
    pub numbers: Vec<f32>,
}

/// The robot of a context with its uncertainty.
#[derive(Debug)]
pub(super) struct Known {
    pub state: State,
    pub posterior: Posterior,
    /// Positions of the context to which the numbers were fitted, where these are not the measured
    /// ones.
    pub smoothed: Option<Vec<f32>>,
    /// A root of the covariance at the end of the context, `[row, column]`, where positions are
    /// filtered: the angles in rad, then the velocities in rad/s.
    pub motion: Option<DMatrix<f64>>,
}

/// A drawn robot that the context allows, at the end of the context.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    pub state: State,
    /// Torques that act on it, from the last sample but one of the context on, `[sample, joint]`,
    /// N·m.
    pub u: Vec<f32>,
}

/// The distance of robots from the most likely one, in standard deviations of the regression. It is
/// log-normal over robots.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doubt {
    /// Logarithm of the distance's median.
    pub median: f32,
    /// Standard deviation of the logarithm.
    pub tail: f32,
    /// Logarithm of the share of the residual torque that a draw at a distance of 1 adds.
    pub torque: f32,
}

impl Doubt {
    /// The distance of a robot with the standard normal number `normal`.
    pub fn scale(self, normal: f32) -> f32 {
        self.tail.mul_add(normal, self.median).exp()
    }
}

impl Law {
    /// Identifies the robot of a context of exact positions.
    pub fn known(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        bounds: Bounds,
    ) -> Known {
        let posterior = self.fit(instructions, recorded, bounds);
        let y = recorded.y[recorded.before()..].to_vec();
        let state = State { y, numbers: narrow(&posterior.mean) };
        Known { state, posterior, smoothed: None, motion: None }
    }

    /// Standard normal numbers of a draw: one for each number of a robot, one for its [`Doubt`],
    /// those of [`LeftOver`], one for each angle and one for each velocity.
    pub fn normals_of_draw(&self) -> usize {
        self.numbers.count() + 1 + leftover::NORMALS + 2 * self.numbers.joints
    }

    /// Draws a robot that the context allows.
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn draw(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        known: &Known,
        left_over: &LeftOver,
        normals: &[f32],
    ) -> Drawn {
        let (of_numbers, normals) = normals.split_at(self.numbers.count());
        let (of_scale, normals) = normals.split_at(1);
        let (of_torques, of_motion) = normals.split_at(leftover::NORMALS);
        let scale = self.doubt.scale(of_scale[0]);
        let mut u = recorded.u[recorded.before()..].to_vec();
        left_over.add(scale * self.doubt.torque.exp(), of_torques, &mut u);
        let mut state = State {
            numbers: self.deviate(instructions, recorded, known, scale, of_numbers),
            ..known.state.clone()
        };
        if let Some(root) = &known.motion {
            let joints = self.numbers.joints;
            let normals = of_motion.iter().copied().map(f64::from);
            let moved = root * DVector::from_iterator(2 * joints, normals);
            for joint in 0..joints {
                let [angle, velocity] = [moved[joint] as f32, moved[joints + joint] as f32];
                state.y[joint] += angle - velocity / recorded.rate_hz;
                state.y[joints + joint] += angle;
            }
        }
        Drawn { state, u }
    }

    /// Numbers at a distance of `scale` standard deviations of the regression from the most likely
    /// ones. The distance is halved while some pose of the context would have too little inertia.
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn deviate(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        known: &Known,
        scale: f32,
        normals: &[f32],
    ) -> Vec<f32> {
        let deviation = known.posterior.deviation(normals);
        let mut scale = scale;
        for _ in 0..HALVINGS {
            let each = known.state.numbers.iter().zip(&deviation);
            let mut numbers: Vec<f32> =
                each.map(|(number, more)| scale.mul_add(*more as f32, *number)).collect();
            self.numbers.keep_bounds(&mut numbers, known.posterior.bounds);
            if self.is_solid(instructions, recorded, &numbers) {
                return numbers;
            }
            scale *= 0.5;
        }
        known.state.numbers.clone()
    }
}

/// A root of the block of the first `size` rows of a covariance of `width` rows.
pub(super) fn root_of_block(covariance: &[f64], width: usize, size: usize) -> DMatrix<f64> {
    let block = DMatrix::from_fn(size, size, |row, column| covariance[row * width + column]);
    Cholesky::new(block).map_or_else(|| DMatrix::zeros(size, size), Cholesky::unpack)
}
