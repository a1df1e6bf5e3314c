//! Robots that were fitted to their contexts, and the torques that motions take of them: the law in the
//! other direction. Instants lie in lanes.

use kernels::Interrupt;
use rayon::prelude::*;
use series::{JointMotion, MeasurementNoise};
use simd::{InstructionSet, Kernel, Lanes, MAX_LANES, with_f32_lanes};
use spec::MAX_JOINTS;

use super::kinematics::Kinematics;
use super::law::{DIRECTIONS, Law, narrow};
use super::pose::{Pose, particle_torques};
use super::prediction::smoother_of;
use super::recorded::Recorded;
use super::regression::Bounds;

impl Law {
    /// The numbers of the most likely robot for each context.
    pub fn most_likely(
        &self,
        instructions: InstructionSet,
        robots: &[Recorded<'_>],
        noise: MeasurementNoise,
    ) -> Vec<Vec<f32>> {
        let Some(first) = robots.first() else { return Vec::new() };
        let smoother = smoother_of(first, noise);
        let filter = smoother.as_ref().map(|smoother| (smoother, noise));
        let interrupt = Interrupt::current();
        let asked = robots.par_iter().inspect(|_| interrupt.leave_if_raised());
        let of_robot = |robot| {
            let found = self.posterior(instructions, robot, filter, Bounds::Dissipation);
            found.most_likely.numbers.as_slice().to_vec()
        };
        asked.map(of_robot).collect()
    }

    /// The torques that a motion takes of the robot with these numbers, `[instant, joint]`, N·m.
    /// They are the same for all instruction sets.
    pub fn torques(
        &self,
        instructions: InstructionSet,
        numbers: &[f32],
        motion: &JointMotion,
    ) -> Vec<f32> {
        let law = self;
        with_f32_lanes!(instructions, L => L::run(TorquesOfMotion { law, numbers, motion }))
    }
}

impl Kinematics {
    /// The torques of each moment of 1 in states, whose positions, velocities and accelerations are
    /// `[point, joint]`: `[point, joint, moment]`, N·m.
    pub fn torques_of_moments(
        &self,
        instructions: InstructionSet,
        states: [&[f32]; 3],
    ) -> Vec<f32> {
        let [q, velocity, acceleration] = states;
        let groups = MAX_LANES * self.joints();
        let each = q.par_chunks(groups).zip(velocity.par_chunks(groups));
        let parts: Vec<Vec<f32>> = each
            .zip(acceleration.par_chunks(groups))
            .map(|((q, velocity), acceleration)| {
                let states = [q, velocity, acceleration];
                with_f32_lanes!(instructions, L => {
                    L::run(TorquesOfMoments { kinematics: self, states })
                })
            })
            .collect();
        parts.concat()
    }
}

/// The torques of moments in a few states, `[state, joint]` each.
struct TorquesOfMoments<'a> {
    kinematics: &'a Kinematics,
    states: [&'a [f32]; 3],
}

impl<L: Lanes> Kernel<L> for TorquesOfMoments<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let Self { kinematics, states } = self;
        let (joints, particles) = (kinematics.joints(), kinematics.particles());
        let count = states[0].len() / joints;
        let mut torques = vec![0.0; count * joints * particles];
        let room = |values: usize| vec![L::splat(0.0); values];
        let rows = DIRECTIONS * particles;
        let [mut jacobians, mut rates] = [rows * joints, rows * joints].map(room);
        let mut bias = room(rows);
        let [mut of_particles, mut of_numbers] =
            [(); 2].map(|()| vec![[L::splat(0.0); MAX_JOINTS]; particles]);
        for first in (0..count).step_by(L::LANES) {
            let lanes = L::LANES.min(count - first);
            let [q, velocity, acceleration] = gathered(states, first, lanes, joints);
            kinematics.update(&q, &velocity, &mut jacobians, &mut rates, &mut bias);
            for (particle, torques) in of_particles.iter_mut().enumerate() {
                *torques = particle_torques([&jacobians, &bias], particle, &acceleration, joints);
            }
            kinematics.gather(&of_particles, &mut of_numbers);
            for (number, of_joints) in of_numbers.iter().enumerate() {
                for (joint, torque) in of_joints.iter().enumerate().take(joints) {
                    let mut of_lanes = [0.0; MAX_LANES];
                    torque.store(&mut of_lanes);
                    for (lane, torque) in of_lanes.iter().enumerate().take(lanes) {
                        let row = (first + lane) * joints + joint;
                        torques[row * particles + number] = *torque;
                    }
                }
            }
        }
        torques
    }
}

/// Values of `lanes` states from `first` on, one state per lane.
#[inline(always)]
fn gathered<L: Lanes>(
    states: [&[f32]; 3],
    first: usize,
    lanes: usize,
    joints: usize,
) -> [[L; MAX_JOINTS]; 3] {
    let mut values = [[[0.0; MAX_LANES]; MAX_JOINTS]; 3];
    let mut loaded = [[L::splat(0.0); MAX_JOINTS]; 3];
    for kind in 0..3 {
        for joint in 0..joints {
            for lane in 0..lanes {
                values[kind][joint][lane] = states[kind][(first + lane) * joints + joint];
            }
            loaded[kind][joint] = L::load(&values[kind][joint]);
        }
    }
    loaded
}

/// The torques of the motion of one robot.
struct TorquesOfMotion<'a> {
    law: &'a Law,
    numbers: &'a [f32],
    motion: &'a JointMotion,
}

impl<L: Lanes> Kernel<L> for TorquesOfMotion<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let Self { law, numbers, motion } = self;
        let (joints, instants) = (law.numbers.joints, motion.instants());
        let numbers = law.weighed(numbers);
        let numbers: Vec<L> = numbers.iter().map(|&number| L::splat(f64::from(number))).collect();
        let dampings = &numbers[law.numbers.dampings()];
        let frictions = &numbers[law.numbers.frictions()];
        let series = [motion.q(), motion.qd(), motion.qdd()].map(narrow);
        let mut torques = vec![0.0; instants * joints];
        let mut pose = Pose::<L>::new(law);
        for first in (0..instants).step_by(L::LANES) {
            let lanes = L::LANES.min(instants - first);
            let states = series.each_ref().map(Vec::as_slice);
            let [q, velocity, acceleration] = gathered(states, first, lanes, joints);
            pose.update(law, &q, &velocity);
            let bias = pose.bias_torques(law, &numbers);
            // Symmetric, and only its lower triangle is there.
            let inertia = pose.inertia(law, &numbers);
            for joint in 0..joints {
                let [friction, _] = law.joints[joint].friction(velocity[joint]);
                let mut torque = dampings[joint].mul_add(velocity[joint], bias[joint]);
                torque = frictions[joint].mul_add(friction, torque);
                for other in 0..joints {
                    let entry = inertia[joint.max(other)][joint.min(other)];
                    torque = entry.mul_add(acceleration[other], torque);
                }
                let mut of_lanes = [0.0; MAX_LANES];
                torque.store(&mut of_lanes);
                for lane in 0..lanes {
                    torques[(first + lane) * joints + joint] = of_lanes[lane];
                }
            }
        }
        torques
    }
}
