//! The arm in one pose per lane: Jacobians of particles, their rates of change, and forces.

#![expect(
    clippy::needless_range_loop,
    reason = "closures do not inline into functions compiled for other instructions; loops over indices do"
)]

use simd::Lanes;
use spec::MAX_JOINTS;

use super::law::{DIRECTIONS, FORCE_UNIT, Law, Network, Places};
use super::linear_algebra::{Dense, TILE, tanh};

/// Buffers for the network's values in every lane, and the results for the latest pose.
pub(super) struct Pose<L> {
    /// The values of a layer and of the next one.
    values: [Vec<L>; 2],
    /// Their rates of change.
    rates: [Vec<L>; 2],
    /// `[direction, particle, joint]`.
    jacobians: Vec<L>,
    jacobian_rates: Vec<L>,
    /// `[1 + force, joint]`, in [`FORCE_UNIT`].
    forces: Vec<L>,
    /// The acceleration of each particle at constant joint velocities, `[direction, particle]`.
    bias_accelerations: Vec<L>,
}

impl<L: Lanes> Pose<L> {
    #[inline(always)]
    pub fn new(law: &Law) -> Self {
        let outputs = |layer: &Dense| layer.outputs.next_multiple_of(TILE);
        let rows = DIRECTIONS * law.numbers.particles;
        let (widest, jacobians, forces) = match &law.places {
            Places::Learned(network) => {
                let seen = 2 * (law.numbers.joints - network.first);
                let widest = network.hidden.iter().map(outputs).max().unwrap_or(0).max(seen);
                let forces = network.forces.as_ref().map_or(0, outputs);
                (widest, outputs(&network.particles), forces)
            }
            Places::Known(_) => (0, rows * law.numbers.joints, 0),
        };
        let room = |count: usize| vec![L::splat(0.0); count];
        let hidden = || [room(widest), room(widest)];
        Self {
            values: hidden(),
            rates: hidden(),
            jacobians: room(jacobians),
            jacobian_rates: room(jacobians),
            forces: room(forces),
            bias_accelerations: room(rows),
        }
    }

    /// Computes the pose at the angles `q`, rad, which change at `velocity`, rad/s.
    #[inline(always)]
    pub fn update(&mut self, law: &Law, q: &[L; MAX_JOINTS], velocity: &[L; MAX_JOINTS]) {
        match &law.places {
            Places::Learned(network) => self.update_learned(law, network, q, velocity),
            Places::Known(kinematics) => kinematics.update(
                q,
                velocity,
                &mut self.jacobians,
                &mut self.jacobian_rates,
                &mut self.bias_accelerations,
            ),
        }
    }

    #[inline(always)]
    fn update_learned(
        &mut self,
        law: &Law,
        network: &Network,
        q: &[L; MAX_JOINTS],
        velocity: &[L; MAX_JOINTS],
    ) {
        let first = network.first;
        let seen = law.numbers.joints - first;
        for input in 0..seen {
            let (sin, cos) = q[first + input].sin_cos();
            self.values[0][input] = sin;
            self.values[0][seen + input] = cos;
            self.rates[0][input] = cos * velocity[first + input];
            self.rates[0][seen + input] = -(sin * velocity[first + input]);
        }
        let mut last = 0;
        for layer in &network.hidden {
            let [even, odd] = &mut self.values;
            let (x, y) = if last == 0 { (even, odd) } else { (odd, even) };
            let [even, odd] = &mut self.rates;
            let (rate, rate_after) = if last == 0 { (even, odd) } else { (odd, even) };
            layer.apply_moving([x, rate], [y, rate_after]);
            for output in 0..layer.outputs {
                let value = tanh(y[output]);
                let slope = value.neg_mul_add(value, L::splat(1.0));
                y[output] = value;
                rate_after[output] = rate_after[output] * slope;
            }
            last = 1 - last;
        }
        let (x, rate) = (&self.values[last], &self.rates[last]);
        network.particles.apply_moving([x, rate], [&mut self.jacobians, &mut self.jacobian_rates]);
        if let Some(forces) = &network.forces {
            forces.apply(x, &mut self.forces);
        }
        self.update_bias_accelerations(law, first, velocity);
    }

    #[inline(always)]
    fn update_bias_accelerations(&mut self, law: &Law, first: usize, velocity: &[L; MAX_JOINTS]) {
        let (particles, joints) = (law.numbers.particles, law.numbers.joints);
        for row in 0..DIRECTIONS * particles {
            let rates = &self.jacobian_rates[row * joints..][..joints];
            let mut sum = L::splat(0.0);
            for joint in 0..joints {
                sum = rates[joint].mul_add(velocity[joint], sum);
            }
            self.bias_accelerations[row] = sum;
        }
        if first == 0 {
            return;
        }
        for particle in 0..particles {
            let [x, y] = [0, 1].map(|direction| direction * particles + particle);
            let [mut along_x, mut along_y] = [L::splat(0.0); 2];
            for joint in 0..joints {
                along_x = self.jacobians[x * joints + joint].mul_add(velocity[joint], along_x);
                along_y = self.jacobians[y * joints + joint].mul_add(velocity[joint], along_y);
            }
            self.bias_accelerations[x] =
                velocity[0].neg_mul_add(along_y, self.bias_accelerations[x]);
            self.bias_accelerations[y] = velocity[0].mul_add(along_x, self.bias_accelerations[y]);
        }
    }

    /// The torques of a particle of weight 1, N·m, at an acceleration of the joints in rad/s².
    #[inline(always)]
    pub fn particle(
        &self,
        law: &Law,
        particle: usize,
        acceleration: &[L; MAX_JOINTS],
    ) -> [L; MAX_JOINTS] {
        let known = [&*self.jacobians, &*self.bias_accelerations];
        particle_torques(known, particle, acceleration, law.numbers.joints)
    }

    /// A force of strength 1, N·m. Force 0 acts on every robot.
    #[inline(always)]
    pub fn force(&self, law: &Law, force: usize) -> [L; MAX_JOINTS] {
        let joints = law.numbers.joints;
        let mut torques = [L::splat(0.0); MAX_JOINTS];
        if let Some(forces) = self.forces.get(force * joints..(force + 1) * joints) {
            for joint in 0..joints {
                torques[joint] = forces[joint] * L::splat(f64::from(FORCE_UNIT));
            }
        }
        torques
    }

    /// The torques of all particles, forces and offsets that do not depend on the acceleration, N·m,
    /// for the `numbers` of every lane.
    #[inline(always)]
    pub fn bias_torques(&self, law: &Law, numbers: &[L]) -> [L; MAX_JOINTS] {
        let joints = law.numbers.joints;
        let mut torques = self.force(law, 0);
        for (force, &strength) in numbers[law.numbers.strengths()].iter().enumerate() {
            let force = self.force(law, 1 + force);
            for joint in 0..joints {
                torques[joint] = strength.mul_add(force[joint], torques[joint]);
            }
        }
        for direction in 0..DIRECTIONS {
            for (particle, &weight) in numbers[law.numbers.weights()].iter().enumerate() {
                let row = direction * law.numbers.particles + particle;
                let jacobian = &self.jacobians[row * joints..][..joints];
                let bias_accelerations = weight * self.bias_accelerations[row];
                for joint in 0..joints {
                    torques[joint] = jacobian[joint].mul_add(bias_accelerations, torques[joint]);
                }
            }
        }
        for (torque, &offset) in torques.iter_mut().zip(&numbers[law.numbers.offsets()]) {
            *torque = *torque + offset;
        }
        torques
    }

    /// The lower triangle of the mass matrix, kg m², for the `numbers` of every lane.
    #[inline(always)]
    pub fn inertia(&self, law: &Law, numbers: &[L]) -> [[L; MAX_JOINTS]; MAX_JOINTS] {
        let joints = law.numbers.joints;
        let mut matrix = [[L::splat(0.0); MAX_JOINTS]; MAX_JOINTS];
        for joint in 0..joints {
            matrix[joint][joint] = L::splat(f64::from(law.joints[joint].armature));
        }
        for (joint, &rotor) in numbers[law.numbers.rotors()].iter().enumerate() {
            matrix[joint][joint] = matrix[joint][joint] + rotor;
        }
        for direction in 0..DIRECTIONS {
            for (particle, &weight) in numbers[law.numbers.weights()].iter().enumerate() {
                let row = direction * law.numbers.particles + particle;
                let jacobian = &self.jacobians[row * joints..][..joints];
                for joint in 0..joints {
                    let weighted = weight * jacobian[joint];
                    for other in 0..=joint {
                        matrix[joint][other] =
                            weighted.mul_add(jacobian[other], matrix[joint][other]);
                    }
                }
            }
        }
        matrix
    }
}

/// The torques of a particle of weight 1, N·m, at an acceleration of the joints in rad/s². It needs
/// the Jacobians `[direction, particle, joint]` and the accelerations at constant joint velocities
/// `[direction, particle]` of all particles.
#[inline(always)]
pub(super) fn particle_torques<L: Lanes>(
    [jacobians, bias_accelerations]: [&[L]; 2],
    particle: usize,
    acceleration: &[L; MAX_JOINTS],
    joints: usize,
) -> [L; MAX_JOINTS] {
    let particles = bias_accelerations.len() / DIRECTIONS;
    let mut torques = [L::splat(0.0); MAX_JOINTS];
    for direction in 0..DIRECTIONS {
        let row = direction * particles + particle;
        let jacobian = &jacobians[row * joints..][..joints];
        let mut accelerated = bias_accelerations[row];
        for joint in 0..joints {
            accelerated = jacobian[joint].mul_add(acceleration[joint], accelerated);
        }
        for joint in 0..joints {
            torques[joint] = jacobian[joint].mul_add(accelerated, torques[joint]);
        }
    }
    torques
}
