//! The fit of a robot to its context. Samples lie in lanes.

#![expect(
    clippy::needless_range_loop,
    reason = "closures do not inline into functions compiled for other instructions; loops over indices do"
)]

use simd::{InstructionSet, Kernel, Lanes, MAX_LANES, with_f32_lanes};
use spec::MAX_JOINTS;

use super::disturbance::Disturbance;
use super::filtering::FilteredContext;
use super::law::{LEAST_PIVOT, Law, Places, narrow};
use super::linear_algebra::Factored;
use super::pose::Pose;
use super::recorded::Recorded;
use super::regression::{Bounds, Equation, Equations, Posterior, Regression};

/// The stride in samples where only poses matter: an eighth of a second at 60 Hz.
const EVERY: usize = 8;
/// Rounds in which the noise of a context is estimated again from the residuals of the last fit.
const NOISE_ROUNDS: usize = 3;

/// Times that moments are moved half-way to those that robots have in the mean.
const HALVINGS: usize = 8;

/// Values of up to [`MAX_LANES`] samples, `[joint, lane]`.
type Gathered = [[f32; MAX_LANES]; MAX_JOINTS];

/// A robot at the end of its context.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// Positions at the last two samples, `[sample, joint]`, rad, or at the only one.
    pub y: Vec<f32>,
    /// In the order of [`super::regression::Numbers`].
    pub numbers: Vec<f32>,
}

/// The distribution of a robot given its context.
#[derive(Debug)]
pub(super) struct RobotPosterior {
    pub most_likely: State,
    pub numbers: Posterior,
    /// The findings of the filter, where positions are filtered.
    pub filtered: Option<FilteredContext>,
    /// The torque that the law does not explain, at the end of the context.
    pub disturbance: Disturbance,
}

impl Law {
    /// Identifies the robot of a context of exact positions.
    pub fn identify(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        bounds: Bounds,
    ) -> RobotPosterior {
        let numbers = self.fit(instructions, recorded, bounds);
        let y = recorded.y[recorded.before()..].to_vec();
        let most_likely = State { y, numbers: narrow(&numbers.mean) };
        let disturbance = self.disturbance(instructions, recorded, &numbers.mean);
        RobotPosterior { most_likely, numbers, filtered: None, disturbance }
    }

    /// The distribution of a robot's numbers given its context. `bounds` decides whether masses may
    /// be negative. If negative masses leave some pose of the context too little inertia, the robot
    /// is fitted again with masses of 0 or more. Moments move half-way to those that robots have in
    /// the mean instead, and again until the inertia suffices.
    pub fn fit(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        bounds: Bounds,
    ) -> Posterior {
        let regression = self.regression_of(instructions, recorded);
        self.fit_within(instructions, recorded, &regression, bounds, None)
    }

    /// The sums over the equations of a context.
    pub fn regression_of(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
    ) -> Regression {
        let (law, mut regression) = (self, Regression::new(self.numbers));
        let each = |equation: &Equation<'_>| regression.add(equation);
        with_f32_lanes!(instructions, L => L::run(ContextEquations { law, recorded, each }));
        regression
    }

    /// [`Law::fit`] with the context's sums. If it is known how large each joint's residual torque is
    /// at `most`, N·m, what is above that does not count.
    pub fn fit_within(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        regression: &Regression,
        bounds: Bounds,
        most: Option<&[f64]>,
    ) -> Posterior {
        let mut found = self.fit_with(regression, recorded, bounds, most);
        let masses = bounds == Bounds::DissipationAndMasses;
        if self.numbers.moments {
            if masses {
                found.halve(&self.prior, self.numbers);
            }
            for _ in 0..HALVINGS {
                if self.has_enough_inertia(instructions, recorded, &narrow(&found.mean)) {
                    break;
                }
                found.halve(&self.prior, self.numbers);
            }
            return found;
        }
        if masses || self.has_enough_inertia(instructions, recorded, &narrow(&found.mean)) {
            return found;
        }
        self.fit_with(regression, recorded, Bounds::DissipationAndMasses, most)
    }

    /// The equations of a context.
    pub fn equations_of(&self, instructions: InstructionSet, recorded: &Recorded<'_>) -> Equations {
        let (law, mut equations) = (self, Equations::new(self.numbers));
        let each = |equation: &Equation<'_>| equations.push(equation);
        with_f32_lanes!(instructions, L => L::run(ContextEquations { law, recorded, each }));
        equations
    }

    /// Whether the arm has enough inertia in the poses of its context.
    pub fn has_enough_inertia(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        numbers: &[f32],
    ) -> bool {
        let law = self;
        let least =
            with_f32_lanes!(instructions, L => L::run(LeastPivot { law, recorded, numbers }));
        least >= LEAST_PIVOT
    }

    /// Fits the numbers. The noise of a joint is raised to its residual torque, or to `most` of it,
    /// where that exceeds the noise of training, because the law is worse there or positions were
    /// smoothed.
    pub fn fit_with(
        &self,
        regression: &Regression,
        recorded: &Recorded<'_>,
        bounds: Bounds,
        most: Option<&[f64]>,
    ) -> Posterior {
        let least = self.noise(recorded);
        let mut noise = least.clone();
        let mut posterior = regression.bounded_posterior(&self.prior, &noise, bounds);
        let repeated = self.repeated(recorded);
        for _ in 0..NOISE_ROUNDS {
            for (joint, noise) in noise.iter_mut().enumerate() {
                let residual = regression.residual_torque(joint, &posterior.mean);
                let residual = most.map_or(residual, |most| residual.min(most[joint]));
                *noise = least[joint].max(repeated * residual);
            }
            posterior = regression.bounded_posterior(&self.prior, &noise, bounds);
        }
        posterior
    }

    /// The standard deviation of each joint's torques with which a context counts as
    /// [`Law::points`] samples, N·m.
    fn noise(&self, recorded: &Recorded<'_>) -> Vec<f64> {
        let repeated = self.repeated(recorded);
        self.joints.iter().map(|joint| repeated * f64::from(joint.noise)).collect()
    }

    /// The root of the number of samples that count as one.
    fn repeated(&self, recorded: &Recorded<'_>) -> f64 {
        let samples = recorded.samples().saturating_sub(2) as f64;
        (samples / self.points as f64).max(1.0).sqrt()
    }
}

/// Calls `each` with the equation of each joint, in order, at every sample with a sample on both
/// sides.
struct ContextEquations<'a, E> {
    law: &'a Law,
    recorded: &'a Recorded<'a>,
    each: E,
}

impl<L: Lanes, E: FnMut(&Equation<'_>)> Kernel<L> for ContextEquations<'_, E> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let Self { law, recorded, .. } = self;
        let joints = law.numbers.joints;
        let shared = law.numbers.shared().len();
        let mut pose = Pose::<L>::new(law);
        // `[particle or force]` of each joint in every lane.
        let mut features: Vec<Gathered> = vec![[[0.0; MAX_LANES]; MAX_JOINTS]; 1 + shared];
        let [mut of_particles, mut of_numbers] =
            [(); 2].map(|()| vec![[L::splat(0.0); MAX_JOINTS]; law.numbers.particles]);
        let mut equation = vec![0.0; shared];
        let mut sample = 1;
        while sample + 1 < recorded.samples() {
            let lanes = L::LANES.min(recorded.samples() - 1 - sample);
            let mut gathered: [Gathered; 4] = [[[0.0; MAX_LANES]; MAX_JOINTS]; 4];
            for lane in 0..lanes {
                for joint in 0..joints {
                    let motion = recorded.motion(sample + lane, joint);
                    gathered[0][joint][lane] = recorded.y[(sample + lane) * joints + joint];
                    gathered[1][joint][lane] = motion.change * recorded.rate_hz;
                    gathered[2][joint][lane] = motion.middle();
                    gathered[3][joint][lane] = motion.velocity_at(law.joints[joint].share);
                }
            }
            let [mut q, mut acceleration, mut velocity] = [[L::splat(0.0); MAX_JOINTS]; 3];
            let mut friction: Gathered = [[0.0; MAX_LANES]; MAX_JOINTS];
            for joint in 0..joints {
                q[joint] = L::load(&gathered[0][joint]);
                acceleration[joint] = L::load(&gathered[1][joint]);
                velocity[joint] = L::load(&gathered[2][joint]);
                let [shape, _] = law.joints[joint].friction(L::load(&gathered[3][joint]));
                shape.store(&mut friction[joint]);
            }
            pose.update(law, &q, &velocity);
            for particle in 0..law.numbers.particles {
                of_particles[particle] = pose.particle(law, particle, &acceleration);
            }
            let weights = match &law.places {
                Places::Learned(_) => &of_particles,
                Places::Known(kinematics) => {
                    kinematics.gather(&of_particles, &mut of_numbers);
                    &of_numbers
                }
            };
            for (torques, places) in weights.iter().zip(&mut features) {
                for joint in 0..joints {
                    torques[joint].store(&mut places[joint]);
                }
            }
            // The force that acts on every robot comes last.
            for force in 0..=law.numbers.forces {
                let torques = pose.force(law, force);
                let place = if force == 0 { shared } else { law.numbers.particles + force - 1 };
                for joint in 0..joints {
                    torques[joint].store(&mut features[place][joint]);
                }
            }
            for lane in 0..lanes {
                for joint in 0..joints {
                    let constants = law.joints[joint];
                    for (number, place) in equation.iter_mut().zip(&features) {
                        *number = place[joint][lane];
                    }
                    let motion = recorded.motion(sample + lane, joint);
                    let inertia = constants.armature * gathered[1][joint][lane];
                    (self.each)(&Equation {
                        joint,
                        shared: &equation,
                        own: law.numbers.own_factors(
                            gathered[3][joint][lane],
                            friction[joint][lane],
                            gathered[1][joint][lane],
                        ),
                        torque: motion.torque_at(constants.share)
                            - inertia
                            - features[shared][joint][lane],
                    });
                }
            }
            sample += lanes;
        }
    }
}

/// The least pivot of the mass matrix at the poses of the context, as a ratio to the inertia of the
/// joint alone. It is at least 1 where no mass is negative.
struct LeastPivot<'a> {
    law: &'a Law,
    recorded: &'a Recorded<'a>,
    numbers: &'a [f32],
}

impl<L: Lanes> Kernel<L> for LeastPivot<'_> {
    type Output = f32;

    #[inline(always)]
    fn run(self) -> f32 {
        let Self { law, recorded, numbers } = self;
        let joints = law.numbers.joints;
        let mut pose = Pose::<L>::new(law);
        let numbers = law.weighed(numbers);
        let numbers: Vec<L> = numbers.iter().map(|&number| L::splat(f64::from(number))).collect();
        let mut armatures = [L::splat(0.0); MAX_JOINTS];
        for joint in 0..joints {
            armatures[joint] = L::splat(f64::from(law.joints[joint].armature));
        }
        let standing = [L::splat(0.0); MAX_JOINTS];
        let mut least = f32::INFINITY;
        // The samples are the same whatever the number of lanes.
        let last = recorded.samples().saturating_sub(1) / EVERY * EVERY;
        for first in (0..=last).step_by(EVERY * L::LANES) {
            let mut gathered: Gathered = [[0.0; MAX_LANES]; MAX_JOINTS];
            for lane in 0..L::LANES {
                let sample = (first + EVERY * lane).min(last);
                for joint in 0..joints {
                    gathered[joint][lane] = recorded.y[sample * joints + joint];
                }
            }
            let mut q = [L::splat(0.0); MAX_JOINTS];
            for joint in 0..joints {
                q[joint] = L::load(&gathered[joint]);
            }
            pose.update(law, &q, &standing);
            let factored = Factored::new(joints, pose.inertia(law, &numbers), &armatures);
            let mut ratios = [0.0; MAX_LANES];
            factored.least.store(&mut ratios);
            for lane in 0..L::LANES {
                // A NaN also becomes the least.
                least = if ratios[lane] >= least { least } else { ratios[lane] };
            }
        }
        least
    }
}
