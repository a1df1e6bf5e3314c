//! The features: the factors of a robot's parameters in the equations of motion, as tensors with
//! gradients.
//!
//! A particle has a Jacobian Bᵀ of three rows: its velocity is Bᵀ v. By d'Alembert's principle a
//! particle of mass 1 loads the joints with B (Bᵀ a + Ḃᵀ v). Where the network does not see the
//! first joint, Bᵀ v is the velocity in a frame that turns with this joint about the third axis.
//! Its rate of change then includes the turning.

use burn::tensor::{Tensor, activation};

use super::Lagrangian;
use super::law::{DIRECTIONS, FORCE_UNIT};
use crate::activations::Activations;

/// The input of the network at samples.
#[derive(Clone)]
pub(super) struct Samples<A> {
    /// Sines, then cosines of angles, `[robot, point, 2 · input]`.
    pub pose: A,
    /// The rates of change of `pose`, 1/s.
    pub rate: A,
    /// rad/s, `[robot · point, 1, joint]`.
    pub velocity: A,
    /// rad/s², `[robot · point, 1, joint]`.
    pub acceleration: A,
    /// How fast the frame of the particles turns, rad/s, `[robot · point, 1, 1]`; 0 where the
    /// network sees all joints.
    pub turning: A,
}

impl Lagrangian {
    /// Two tensors of torques in N·m. The first has those of each particle of weight 1, then of
    /// each force of strength 1, `[robot · point, joint, particle or force]`. The second has those
    /// of the force that acts on every robot, if there is one, `[robot · point, joint, 1]`.
    pub(super) fn features<A: Activations>(&self, samples: Samples<A>) -> (A, Option<A>) {
        let Samples { pose, rate, velocity, acceleration, turning } = samples;
        let [rows, _, joints] = acceleration.dims();
        let (mut x, mut tangent) = (pose, rate);
        for layer in &self.hidden {
            x = tanh(layer.forward(x));
            let slope = {
                let shape = x.dims();
                A::operation([x.clone()], [true], shape, |[x]| x.square().neg() + 1.0)
            };
            tangent = layer.forward_without_bias(tangent).times(slope);
        }
        let particles = self.numbers.particles;
        let shape = [rows, DIRECTIONS * particles, joints];
        let forces = self.forces.as_ref().map(|forces| {
            let numbers = forces.forward(x.clone());
            let [_, _, width] = numbers.dims();
            let shape = numbers.dims();
            let scaled = A::operation([numbers], [false], shape, |[x]| x * FORCE_UNIT);
            scaled.reshaped([rows, width / joints, joints])
        });
        let jacobian = self.particles.forward(x).reshaped(shape);
        let jacobian_rate = self.particles.forward_without_bias(tangent).reshaped(shape);
        let along = |jacobian: &A, vector: &A| sum(weighted(jacobian.clone(), vector.clone()), 2);
        let moving = along(&jacobian, &velocity);
        let part = |direction: usize| {
            moving.clone().part(1, direction * particles..(direction + 1) * particles)
        };
        let backwards = {
            let shape = turning.dims();
            A::operation([turning.clone()], [false], shape, |[x]| x.neg())
        };
        let still =
            part(2).constant([rows, particles, 1], |shape, device| Tensor::zeros(shape, device));
        let turned = weighted(part(1), backwards).and(weighted(part(0), turning), 1).and(still, 1);
        let accelerated =
            along(&jacobian, &acceleration).plus(along(&jacobian_rate, &velocity)).plus(turned);
        let torques = jacobian.times(accelerated);
        let of_direction = |direction: usize| {
            torques.clone().part(1, direction * particles..(direction + 1) * particles)
        };
        let particles = of_direction(0).plus(of_direction(1)).plus(of_direction(2)).transposed();
        let Some(forces) = forces else { return (particles, None) };
        let forces = forces.transposed();
        let [_, _, count] = forces.dims();
        (particles.and(forces.clone().part(2, 1..count), 2), Some(forces.part(2, 0..1)))
    }

    /// Friction of strength 1 at a velocity in rad/s, `[robot, point, joint]`; 0 at rest.
    pub(super) fn friction(&self, velocity: Tensor<3>) -> Tensor<3> {
        let slope = self.paced(&self.friction_slope).exp();
        let shift = self.friction_shift.val().unsqueeze::<3>();
        let at_rest = activation::tanh(slope.clone() * shift.clone());
        activation::tanh((velocity + shift) * slope) - at_rest
    }
}

/// The torques of every combination of numbers, `[robot, row, column]`: the product of the features
/// `[robot, row, number]` and the combinations `[robot, number, column]`.
pub(super) fn combined<A: Activations>(features: A, combinations: A) -> A {
    let [robots, rows, _] = features.dims();
    let shape = [robots, rows, combinations.dims()[2]];
    A::operation([features, combinations], [false, true], shape, |[x, y]| x.matmul(y))
}

fn tanh<A: Activations>(x: A) -> A {
    let shape = x.dims();
    A::operation([x], [true], shape, |[x]| kernels::tanh(x))
}

/// The product with constants, which may have extents of 1.
fn weighted<A: Activations>(x: A, weights: A) -> A {
    let shape = x.dims();
    A::operation([x, weights], [false, true], shape, |[x, weights]| x * weights)
}

fn sum<A: Activations>(x: A, dimension: usize) -> A {
    let mut shape = x.dims();
    shape[dimension] = 1;
    A::operation([x], [false], shape, |[x]| x.sum_dim(dimension))
}
