//! The lengths and axes of an arm that the law is not told. The first batch of a training shows them.
//!
//! An arm is taken as a chain of rotating joints. Once the axes are known, its torques are linear in
//! the moments of its links, and in damping, friction, rotor and offset of each joint
//! ([`super::kinematics`]). So a chain is sought whose best linear fit to each of many arms leaves the
//! least residual torque ([`fit`], [`search`]). In the end the shapes of frictions are fitted as well
//! ([`arm`]). What the data cannot tell stays open and changes no
//! prediction: where along its axis a joint is, how the base is turned about the vertical, and whether
//! the arm is its own mirror image.

mod arm;
mod fit;
mod search;

use std::f64::consts::PI;

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use nalgebra::{DMatrix, Rotation3, Vector3};
use random::{ChaCha8Rng, normal};
use spec::Gravity;

use super::kinematics::{Frame, Kinematics};
use super::law::Limits;
use super::{values, with};
use crate::initialization::InitialWeights;

pub(super) use self::arm::Arm;
pub(super) use self::fit::Motions;
pub(super) use self::search::find;

/// Typical distance of a joint from the base in each direction where a search starts, m.
const START_M: f64 = 0.3;
/// Values of a joint in a stored chain: nine of its turn, row by row, three of its origin in m, its
/// least and largest position in rad, and its largest speed in rad/s.
const STORED: usize = 15;
/// Ways to move a joint's axis: two turns and two shifts across it.
const MOVES: usize = 4;

/// The arm that a law has found. No step of the training changes it.
#[derive(Module, Debug)]
pub(super) struct FoundChain {
    /// [`Chain::stored`], `[joint, value]`.
    places: Param<Tensor<2>>,
    /// The moments of links that a robot's numbers stand for, `[moment, number]`. Over robots the
    /// numbers are independent, while a load changes many moments together.
    basis: Param<Tensor<2>>,
}

impl FoundChain {
    /// A chain that nothing is known of.
    pub fn unknown(limits: &[Limits], gravity: Gravity, weights: &mut InitialWeights<'_>) -> Self {
        let joints = limits.len();
        let chain = Chain::straight(joints);
        let moments = chain.kinematics(gravity).particles();
        let places = weights.given([joints, STORED], chain.stored(limits));
        Self { places, basis: weights.given([moments, moments], identity(moments)) }
    }

    /// Another chain, whose numbers are the moments themselves.
    pub fn with_chain(mut self, chain: &Chain, limits: &[Limits]) -> Self {
        let [moments, _] = self.basis.dims();
        self.places = with(self.places, chain.stored(limits));
        self.with_basis(identity(moments))
    }

    #[cfg(test)]
    pub fn places(&self) -> Vec<f32> {
        values(self.places.val())
    }

    pub fn basis(&self) -> DMatrix<f64> {
        let [size, _] = self.basis.dims();
        DMatrix::from_row_slice(size, size, &values(self.basis.val())).map(f64::from)
    }

    pub fn with_basis(mut self, basis: Vec<f32>) -> Self {
        self.basis = with(self.basis, basis);
        self
    }

    pub fn kinematics(&self, gravity: Gravity) -> Kinematics {
        let (chain, _) = Chain::of_stored(&values(self.places.val()));
        chain.kinematics(gravity).in_basis(&values(self.basis.val()))
    }

    pub fn limits(&self) -> Vec<Limits> {
        Chain::of_stored(&values(self.places.val())).1
    }
}

/// The frame of each joint in the world, whose third axis the joint turns about, with the arm at
/// position 0.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    frames: Vec<Frame>,
}

impl Chain {
    /// A chain of random joints.
    pub fn random(joints: usize, generator: &mut ChaCha8Rng) -> Self {
        Self { frames: (0..joints).map(|_| random_frame(generator)).collect() }
    }

    /// The chain with another axis of one joint, at the same place.
    pub fn with_random_axis(&self, joint: usize, generator: &mut ChaCha8Rng) -> Self {
        let mut chain = self.clone();
        chain.frames[joint].turn = random_frame(generator).turn;
        chain
    }

    /// The chain with one joint turning the other way.
    pub fn with_opposite_axis(&self, joint: usize) -> Self {
        let mut chain = self.clone();
        let half_turn = Rotation3::from_axis_angle(&Vector3::x_axis(), PI);
        chain.frames[joint].turn *= half_turn.into_inner();
        chain
    }

    /// An upright chain, before anything is known.
    pub fn straight(joints: usize) -> Self {
        let frames = (0..joints).map(|joint| {
            let axis = if joint % 2 == 0 { Vector3::z() } else { Vector3::y() };
            let turn = Rotation3::rotation_between(&Vector3::z(), &axis).unwrap_or_default();
            let origin = Vector3::new(0.0, 0.0, joint as f64 * START_M);
            Frame { turn: turn.into_inner(), origin }
        });
        Self { frames: frames.collect() }
    }

    fn joints(&self) -> usize {
        self.frames.len()
    }

    pub fn kinematics(&self, gravity: Gravity) -> Kinematics {
        Kinematics::of_chain(&self.frames, gravity)
    }

    /// The number of ways to move one axis. The base may be anywhere, so the first axis only turns.
    fn moves(&self) -> usize {
        (MOVES * self.frames.len()).saturating_sub(2)
    }

    /// The chain with every axis moved: rad about x and y and m along x and y of each joint's frame.
    /// The first joint has no shifts.
    fn moved(&self, moves: &[f64]) -> Self {
        let (first, others) = moves.split_at(2);
        let each = std::iter::once([first[0], first[1], 0.0, 0.0])
            .chain(others.as_chunks::<MOVES>().0.iter().copied());
        let frames = self.frames.iter().zip(each).map(|(frame, [about_x, about_y, x, y])| {
            let turn = Rotation3::new(Vector3::new(about_x, about_y, 0.0));
            let origin = frame.origin + frame.turn * Vector3::new(x, y, 0.0);
            Frame { turn: frame.turn * turn.into_inner(), origin }
        });
        Self { frames: frames.collect() }
    }

    /// The same chain with each joint at the place of its axis that is next to the joint before.
    fn gathered(&self) -> Self {
        let mut before = Vector3::zeros();
        let frames = self.frames.iter().map(|frame| {
            let axis = frame.turn.column(2);
            let origin = frame.origin + axis * axis.dot(&(before - frame.origin));
            before = origin;
            Frame { turn: frame.turn, origin }
        });
        Self { frames: frames.collect() }
    }

    /// The values of a parameter, `[joint, value]`, with the limits of each joint.
    #[expect(clippy::cast_possible_truncation, reason = "parameters are f32")]
    pub fn stored(&self, limits: &[Limits]) -> Vec<f32> {
        let each = self.frames.iter().zip(limits);
        each.flat_map(|(frame, limits)| {
            let turn = frame.turn.transpose();
            let place = turn.iter().chain(frame.origin.iter()).map(|value| *value as f32);
            place.chain(limits.position).chain([limits.speed]).collect::<Vec<f32>>()
        })
        .collect()
    }

    /// The chain and the limits of a parameter.
    pub fn of_stored(values: &[f32]) -> (Self, Vec<Limits>) {
        let rows = values.as_chunks::<STORED>().0.iter();
        let each = rows.map(|row| {
            let place = row.map(f64::from);
            let frame = Frame {
                turn: nalgebra::Matrix3::from_row_slice(&place[..9]),
                origin: Vector3::from_column_slice(&place[9..12]),
            };
            (frame, Limits { position: [row[12], row[13]], speed: row[14] })
        });
        let (frames, limits) = each.unzip();
        (Self { frames }, limits)
    }
}

/// `[row, column]`.
fn identity(size: usize) -> Vec<f32> {
    (0..size * size).map(|at| f32::from(u8::from(at % (size + 1) == 0))).collect()
}

fn random_frame(generator: &mut ChaCha8Rng) -> Frame {
    let mut drawn = || Vector3::from_fn(|_, _| normal(generator));
    let (axis, origin) = (drawn(), drawn() * START_M);
    let turn = Rotation3::rotation_between(&Vector3::z(), &axis).unwrap_or_default();
    Frame { turn: turn.into_inner(), origin }
}
