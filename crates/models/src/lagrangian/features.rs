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
use super::regression::Numbers;

/// The input of the network at samples.
#[derive(Clone)]
pub(super) struct Samples {
    /// Sines, then cosines of angles, `[robot, point, 2 · input]`.
    pub pose: Tensor<3>,
    /// The rates of change of `pose`, 1/s.
    pub rate: Tensor<3>,
    /// rad/s, `[robot · point, 1, joint]`.
    pub velocity: Tensor<3>,
    /// rad/s², `[robot · point, 1, joint]`.
    pub acceleration: Tensor<3>,
    /// How fast the frame of the particles turns, rad/s, `[robot · point, 1, 1]`; 0 where the
    /// network sees all joints.
    pub turning: Tensor<3>,
}

impl Lagrangian {
    /// Two tensors of torques in N·m. The first has those of each particle of weight 1, then of
    /// each force of strength 1, `[robot · point, joint, particle or force]`. The second has those
    /// of the force that acts on every robot, `[robot · point, joint, 1]`; 0 if there is none.
    pub(super) fn features(&self, samples: Samples) -> [Tensor<3>; 2] {
        let Samples { pose, rate, velocity, acceleration, turning } = samples;
        let [rows, _, joints] = acceleration.dims();
        let (mut x, mut tangent) = (pose, rate);
        for layer in &self.hidden {
            x = kernels::tanh(layer.forward(x));
            tangent = layer.forward_without_bias(tangent) * (x.clone().square().neg() + 1.0);
        }
        let particles = self.numbers.particles;
        let shape = [rows, DIRECTIONS * particles, joints];
        let forces = self.forces.as_ref().map(|forces| {
            let torques = forces.forward(x.clone()) * FORCE_UNIT;
            torques.reshape([rows, 1 + self.numbers.forces, joints])
        });
        let Some(network) = &self.particles else { unreachable!("the law has a network") };
        let jacobian = network.forward(x).reshape(shape);
        let jacobian_rate = network.forward_without_bias(tangent).reshape(shape);
        let along = |jacobian: &Tensor<3>, vector: &Tensor<3>| {
            (jacobian.clone() * vector.clone()).sum_dim(2)
        };
        let in_direction = |torques: &Tensor<3>, direction: usize| {
            let [rows, _, columns] = torques.dims();
            let particles = direction * particles..(direction + 1) * particles;
            torques.clone().slice([0..rows, particles, 0..columns])
        };
        let moving = along(&jacobian, &velocity);
        let backwards = in_direction(&moving, 1) * turning.clone().neg();
        let still = Tensor::zeros([rows, particles, 1], &moving.device());
        let turned = Tensor::cat(vec![backwards, in_direction(&moving, 0) * turning, still], 1);
        let accelerated =
            along(&jacobian, &acceleration) + along(&jacobian_rate, &velocity) + turned;
        let torques = jacobian * accelerated;
        let [first, second, third] = [0, 1, 2].map(|direction| in_direction(&torques, direction));
        let particles = (first + second + third).swap_dims(1, 2);
        let Some(forces) = forces.map(|forces| forces.swap_dims(1, 2)) else {
            let none = Tensor::zeros([rows, joints, 1], &particles.device());
            return [particles, none];
        };
        let [common, own] = [0..1, 1..1 + self.numbers.forces]
            .map(|chosen| forces.clone().slice([0..rows, 0..joints, chosen]));
        [Tensor::cat(vec![particles, own], 2), common]
    }

    /// The values that a training step keeps of the features of a trajectory with `points` points.
    pub(super) fn kept_by_features(&self, points: usize) -> usize {
        let Numbers { particles, joints, .. } = self.numbers;
        let input = 4 * (joints - self.first);
        // The input and the output of each tanh, its slope, and the rate before and after it.
        let hidden: usize = self.hidden.iter().map(|layer| 5 * layer.widths()[1]).sum();
        // Velocity, acceleration, turning with both signs; Jacobians, and accelerations along them.
        let constants = 2 * joints + 2;
        points * (input + hidden + constants + DIRECTIONS * particles * (joints + 1))
    }

    /// Friction of strength 1 at a velocity in rad/s, `[robot, point, joint]`; 0 at rest.
    pub(super) fn friction(&self, velocity: Tensor<3>) -> Tensor<3> {
        let slope = self.paced(&self.friction_slope).exp();
        let shift = self.friction_shift.val().unsqueeze::<3>();
        let at_rest = activation::tanh(slope.clone() * shift.clone());
        activation::tanh((velocity + shift) * slope) - at_rest
    }
}
