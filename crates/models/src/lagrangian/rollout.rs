//! Rollouts of robots over their horizons, with one step of the equation per sample. Robots lie in
//! lanes.

#![expect(
    clippy::needless_range_loop,
    reason = "closures do not inline into functions compiled for other instructions; loops over indices do"
)]

use kernels::Interrupt;
use rayon::prelude::*;
use simd::{InstructionSet, Kernel, Lanes, MAX_LANES, with_f32_lanes};
use spec::MAX_JOINTS;

use super::fitting::State;
use super::law::{LEAST_PIVOT, Law, Limits};
use super::linear_algebra::{Factored, bounded};
use super::pose::Pose;
use super::recorded::Recorded;

/// Times that friction is linearized within a sampling time, each time at the velocity of the last
/// result.
const SWEEPS: usize = 2;

/// A robot at the beginning of its horizon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start<'a> {
    pub recorded: Recorded<'a>,
    /// Its numbers in the order of [`super::regression::Numbers`].
    pub numbers: &'a [f32],
}

impl<'a> Start<'a> {
    /// Starts from the state at the end of a context. `u` are the torques from the last sample but
    /// one of the context on.
    pub fn new(recorded: &Recorded<'_>, u: &'a [f32], state: &'a State) -> Self {
        let Recorded { joints, rate_hz, .. } = *recorded;
        Self { recorded: Recorded { u, y: &state.y, joints, rate_hz }, numbers: &state.numbers }
    }
}

/// The rollouts of robots.
#[derive(Debug, Default)]
pub(super) struct Rollouts {
    /// `[robot, sample, joint]`, rad.
    pub positions: Vec<f32>,
    /// Whether each robot had enough inertia in all its poses.
    pub enough_inertia: Vec<bool>,
}

impl Rollouts {
    /// The robots that reached a pose of too little inertia.
    pub fn with_too_little_inertia(&self) -> Vec<usize> {
        (0..self.enough_inertia.len()).filter(|&robot| !self.enough_inertia[robot]).collect()
    }

    /// Gives a robot the positions of another.
    pub fn replace(&mut self, robot: usize, others: &Self, other: usize) {
        let horizon = self.positions.len() / self.enough_inertia.len();
        let other = &others.positions[other * horizon..][..horizon];
        self.positions[robot * horizon..][..horizon].copy_from_slice(other);
    }

    /// The same with the last `samples` positions of each robot's context in front.
    pub fn behind(mut self, samples: usize, starts: &[Start<'_>]) -> Self {
        if samples == 0 || starts.is_empty() {
            return self;
        }
        let horizon = self.positions.len() / starts.len();
        let mut positions = Vec::with_capacity(self.positions.len() + starts.len() * samples);
        for (at, Start { recorded, .. }) in starts.iter().enumerate() {
            positions.extend(&recorded.y[(recorded.samples() - samples) * recorded.joints..]);
            positions.extend(&self.positions[at * horizon..][..horizon]);
        }
        self.positions = positions;
        self
    }

    fn append(&mut self, mut other: Self) {
        self.positions.append(&mut other.positions);
        self.enough_inertia.append(&mut other.enough_inertia);
    }
}

impl Law {
    /// The rollouts of fitted robots.
    pub fn roll_out(&self, instructions: InstructionSet, starts: &[Start<'_>]) -> Rollouts {
        let interrupt = Interrupt::current();
        let groups: Vec<Rollouts> = starts
            .par_chunks(MAX_LANES)
            .inspect(|_| interrupt.leave_if_raised())
            .map(|robots| with_f32_lanes!(instructions, L => L::run(RollOut { law: self, robots })))
            .collect();
        let mut rollouts = Rollouts::default();
        groups.into_iter().for_each(|group| rollouts.append(group));
        rollouts
    }
}

/// The rollouts of robots with horizons of one length.
struct RollOut<'a> {
    law: &'a Law,
    robots: &'a [Start<'a>],
}

impl<L: Lanes> Kernel<L> for RollOut<'_> {
    type Output = Rollouts;

    #[inline(always)]
    fn run(self) -> Rollouts {
        let Self { law, robots } = self;
        let joints = law.numbers.joints;
        let Some(Start { recorded, .. }) = robots.first() else { return Rollouts::default() };
        let (context, samples) = (recorded.samples(), recorded.u.len() / joints);
        let horizon = samples - context;
        let rate = L::splat(f64::from(recorded.rate_hz));
        let period = rate.recip();
        let mut answer = vec![0.0; robots.len() * horizon * joints];
        let mut enough_inertia = Vec::with_capacity(robots.len());
        let mut pose = Pose::<L>::new(law);
        for (group, answer) in
            robots.chunks(L::LANES).zip(answer.chunks_mut(L::LANES * horizon * joints))
        {
            let mut starts = [[[0.0; MAX_LANES]; MAX_JOINTS]; 2];
            // Torques begin with the sample before the context's last one.
            let mut torques = vec![[[0.0; MAX_LANES]; MAX_JOINTS]; horizon + 1];
            let mut numbers = vec![[0.0; MAX_LANES]; law.numbers.count()];
            for (lane, Start { recorded, numbers: fitted }) in group.iter().enumerate() {
                for (number, fitted) in numbers.iter_mut().zip(law.weighed(fitted)) {
                    number[lane] = fitted;
                }
                for joint in 0..joints {
                    starts[0][joint][lane] = recorded.y[(context - 1) * joints + joint];
                    starts[1][joint][lane] = recorded.last_velocity(joint);
                    for (step, torques) in torques.iter_mut().enumerate() {
                        let sample = (context + step).saturating_sub(2);
                        torques[joint][lane] = recorded.u[sample * joints + joint];
                    }
                }
            }
            let numbers: Vec<L> = numbers.iter().map(|number| L::load(number)).collect();
            let dampings = &numbers[law.numbers.dampings()];
            let frictions = &numbers[law.numbers.frictions()];
            // Inertias of the joints alone, and the same times the rate.
            let [mut armatures, mut least] = [[L::splat(0.0); MAX_JOINTS]; 2];
            for joint in 0..joints {
                armatures[joint] = L::splat(f64::from(law.joints[joint].armature));
                least[joint] = armatures[joint] * rate;
            }
            // The least pivot of the mass matrix so far, as a ratio to the inertia of the joint
            // alone, negated.
            let mut negative_pivot = -L::splat(f64::from(f32::MAX));
            let [mut q, mut velocity] = [[L::splat(0.0); MAX_JOINTS]; 2];
            let mut change = [L::splat(0.0); MAX_JOINTS];
            for joint in 0..joints {
                q[joint] = L::load(&starts[0][joint]);
                velocity[joint] = L::load(&starts[1][joint]);
            }
            // A robot that begins beyond a limit keeps its position or its speed as the limit.
            let [mut lowest, mut highest, mut fastest] = [[L::splat(0.0); MAX_JOINTS]; 3];
            for joint in 0..joints {
                let Limits { position: [low, high], speed } = law.joints[joint].limits;
                lowest[joint] = -((-L::splat(f64::from(low))).max(-q[joint]));
                highest[joint] = L::splat(f64::from(high)).max(q[joint]);
                let speed = L::splat(f64::from(speed));
                fastest[joint] = speed.max(velocity[joint]).max(-velocity[joint]);
            }
            for step in 0..horizon {
                // The velocity in the middle of the step, if it changes as in the last step.
                let mut middle = velocity;
                for joint in 0..joints {
                    middle[joint] = L::splat(0.5).mul_add(change[joint], velocity[joint]);
                }
                pose.update(law, &q, &middle);
                let bias = pose.bias_torques(law, &numbers);
                let mut inertia = pose.inertia(law, &numbers);
                let factored = Factored::new(joints, inertia, &armatures);
                negative_pivot = negative_pivot.max(-factored.least);
                let mut driving = [L::splat(0.0); MAX_JOINTS];
                for joint in 0..joints {
                    let share = L::splat(f64::from(law.joints[joint].share));
                    let before = L::load(&torques[step][joint]);
                    let after = L::load(&torques[step + 1][joint]);
                    let torque = share.mul_add(after - before, before);
                    let damped = dampings[joint].neg_mul_add(velocity[joint], torque);
                    driving[joint] = damped - bias[joint];
                    for other in 0..=joint {
                        inertia[joint][other] = inertia[joint][other] * rate;
                    }
                    inertia[joint][joint] = share.mul_add(dampings[joint], inertia[joint][joint]);
                }
                for _ in 0..SWEEPS {
                    let (mut matrix, mut torques) = (inertia, driving);
                    for joint in 0..joints {
                        let constants = &law.joints[joint];
                        let share = L::splat(f64::from(constants.share));
                        let moved = share * change[joint];
                        let [shape, slope] = constants.friction(velocity[joint] + moved);
                        let (shape, slope) = (frictions[joint] * shape, frictions[joint] * slope);
                        torques[joint] = slope.mul_add(moved, torques[joint] - shape);
                        matrix[joint][joint] = share.mul_add(slope, matrix[joint][joint]);
                    }
                    Factored::new(joints, matrix, &least).solve(joints, &mut torques);
                    for joint in 0..joints {
                        let after = velocity[joint] + torques[joint];
                        let after = bounded(after, -fastest[joint], fastest[joint]);
                        let least = (lowest[joint] - q[joint]) * rate;
                        let most = (highest[joint] - q[joint]) * rate;
                        let after = bounded(after, least, most);
                        change[joint] = after - velocity[joint];
                    }
                }
                for joint in 0..joints {
                    velocity[joint] = velocity[joint] + change[joint];
                    q[joint] = velocity[joint].mul_add(period, q[joint]);
                    let mut positions = [0.0; MAX_LANES];
                    q[joint].store(&mut positions);
                    let at = step * joints + joint;
                    for lane in 0..group.len() {
                        answer[lane * horizon * joints + at] = positions[lane];
                    }
                }
            }
            let mut negative_pivots = [0.0; MAX_LANES];
            negative_pivot.store(&mut negative_pivots);
            enough_inertia
                .extend(negative_pivots[..group.len()].iter().map(|pivot| *pivot <= -LEAST_PIVOT));
        }
        Rollouts { positions: answer, enough_inertia }
    }
}
