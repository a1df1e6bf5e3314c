//! A trained law that predicts: it fits robots to their contexts and integrates the equation over
//! their horizons.
//!
//! The processor computes everything in the lanes of its vectors: many samples at once while a
//! robot is fitted ([`super::fitting`]), and many robots at once while they move
//! ([`super::rollout`]). Lanes of every width give the same bits. A robot's answer does not depend
//! on the other robots of the call.

use kernels::Interrupt;
use rayon::prelude::*;
use series::MeasurementNoise;
use series::Smoother;
use simd::{F32Array, InstructionSet, MAX_LANES};
#[cfg(target_arch = "x86_64")]
use simd::{F32x8, F32x16};

use super::dense::Dense;
use super::filtering::{is_filtered, smoother};
use super::known::{Doubt, Drawn, Known, State};
use super::leftover::LeftOver;
use super::motion::Recorded;
use super::numbers::{Bounds, Numbers};
use super::regression::{Equations, Posterior, Prior, Regression};
use super::rollout::Rolled;

/// Rounds in which the noise of a context is estimated again from the residuals of the last fit.
const NOISE_ROUNDS: usize = 3;
/// Least pivot of a mass matrix, as a ratio to the inertia of the joint alone. Masses of 0 or more
/// keep it at 1, up to rounding.
pub(super) const LEAST_PIVOT: f32 = 0.99;

/// A trained law.
#[derive(Debug)]
pub(super) struct Law {
    pub hidden: Vec<Dense>,
    /// Gives `[direction, particle, joint]`.
    pub particles: Dense,
    /// Gives `[1 + force, joint]`.
    pub forces: Option<Dense>,
    pub joints: Vec<JointLaw>,
    pub prior: Prior,
    pub doubt: Doubt,
    pub numbers: Numbers,
    /// The first joint whose angle the network sees.
    pub first: usize,
    /// The number of independent samples that a context counts as. The law's errors at neighbouring
    /// samples are alike. Training uses this many samples and takes their errors as independent.
    pub points: usize,
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
}

/// A robot at the beginning of its horizon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start<'a> {
    pub recorded: Recorded<'a>,
    /// Its numbers in the order of [`Numbers`].
    pub numbers: &'a [f32],
}

impl<'a> Start<'a> {
    /// Starts from the state at the end of a context. `u` are the torques from the last sample but
    /// one of the context on.
    fn new(recorded: &Recorded<'_>, u: &'a [f32], state: &'a State) -> Self {
        let Recorded { joints, rate_hz, .. } = *recorded;
        Self { recorded: Recorded { u, y: &state.y, joints, rate_hz }, numbers: &state.numbers }
    }
}

impl Law {
    /// Positions of the horizons, `[robot, sample, joint]`, rad. They are the same for all
    /// instruction sets. `draws` is empty, or has [`Law::normals_of_draw`] standard normal numbers
    /// for each robot. Without draws a robot is the most likely one. With draws it is another one
    /// that the context allows. A robot with negative masses that reaches a pose of too little
    /// inertia is fitted again without them.
    pub fn predict(
        &self,
        instructions: InstructionSet,
        robots: &[Recorded<'_>],
        noise: MeasurementNoise,
        draws: &[&[f32]],
    ) -> Vec<f32> {
        let Some(first) = robots.first() else { return Vec::new() };
        let smoother = is_filtered(first, noise).then(|| smoother(first, noise));
        let filter = smoother.as_ref().map(|smoother| (smoother, noise));
        let mut found = self.follow(instructions, robots, filter, draws, Bounds::Own);
        let lost = found.lost();
        if !lost.is_empty() {
            let robots: Vec<Recorded<'_>> = lost.iter().map(|&robot| robots[robot]).collect();
            let drawn = lost.iter().filter_map(|&robot| draws.get(robot).copied());
            let draws: Vec<&[f32]> = drawn.collect();
            let again = self.follow(instructions, &robots, filter, &draws, Bounds::Masses);
            for (place, &robot) in lost.iter().enumerate() {
                found.replace(robot, &again, place);
            }
        }
        found.positions
    }

    /// The horizons of robots that are fitted within these bounds, whatever poses they reach.
    fn follow(
        &self,
        instructions: InstructionSet,
        robots: &[Recorded<'_>],
        filter: Option<(&Smoother, MeasurementNoise)>,
        draws: &[&[f32]],
        bounds: Bounds,
    ) -> Rolled {
        let interrupt = Interrupt::current();
        let asked: Vec<&[Recorded<'_>]> = robots.chunk_by(Recorded::has_the_past_of).collect();
        let known: Vec<Known> = asked
            .par_iter()
            .inspect(|_| interrupt.leave_if_raised())
            .map(|same| match filter {
                None => self.known(instructions, &same[0], bounds),
                Some((smoother, noise)) => {
                    self.filtered(instructions, &same[0], smoother, noise, bounds)
                }
            })
            .collect();
        let spread = |place: usize, same: &[Recorded<'_>]| std::iter::repeat_n(place, same.len());
        let places: Vec<usize> =
            asked.iter().enumerate().flat_map(|(place, same)| spread(place, same)).collect();
        if draws.is_empty() {
            let starts = robots.iter().zip(&places).map(|(robot, &place)| {
                Start::new(robot, &robot.u[robot.before()..], &known[place].state)
            });
            return self.roll_out(instructions, &starts.collect::<Vec<_>>());
        }
        let left_over: Vec<LeftOver> = asked
            .par_iter()
            .inspect(|_| interrupt.leave_if_raised())
            .zip(&known)
            .map(|(same, known)| self.left_over(instructions, &same[0], known))
            .collect();
        let drawn: Vec<Drawn> = draws
            .par_iter()
            .inspect(|_| interrupt.leave_if_raised())
            .zip(&places)
            .zip(robots)
            .map(|((normals, &place), robot)| {
                self.draw(instructions, robot, &known[place], &left_over[place], normals)
            })
            .collect();
        let starts = robots.iter().zip(&drawn);
        let starts = starts.map(|(robot, drawn)| Start::new(robot, &drawn.u, &drawn.state));
        self.roll_out(instructions, &starts.collect::<Vec<_>>())
    }

    /// The horizons of fitted robots.
    pub fn roll_out(&self, instructions: InstructionSet, starts: &[Start<'_>]) -> Rolled {
        let interrupt = Interrupt::current();
        let groups: Vec<Rolled> = starts
            .par_chunks(MAX_LANES)
            .inspect(|_| interrupt.leave_if_raised())
            .map(|group| match instructions {
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512(_) => F32x16::roll(self, group),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2(_) => F32x8::roll(self, group),
                InstructionSet::Portable => F32Array::<8>::roll(self, group),
            })
            .collect();
        let mut rolled = Rolled::default();
        groups.into_iter().for_each(|group| rolled.append(group));
        rolled
    }

    /// The distribution of a robot's numbers given its context. `bounds` decides whether masses may
    /// be negative. If negative masses leave some pose of the context too little inertia, the robot
    /// is fitted again with masses of 0 or more.
    pub fn fit(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        bounds: Bounds,
    ) -> Posterior {
        let regression = self.regression_with(instructions, recorded);
        let found = self.fit_with(&regression, recorded, bounds);
        let solid =
            bounds == Bounds::Masses || self.is_solid(instructions, recorded, &narrow(&found.mean));
        if solid { found } else { self.fit_with(&regression, recorded, Bounds::Masses) }
    }

    /// Whether the arm has enough inertia in the poses of its context.
    pub fn is_solid(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        numbers: &[f32],
    ) -> bool {
        let least = match instructions {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => F32x16::least_pivot(self, recorded, numbers),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => F32x8::least_pivot(self, recorded, numbers),
            InstructionSet::Portable => F32Array::<8>::least_pivot(self, recorded, numbers),
        };
        least >= LEAST_PIVOT
    }

    /// Fits the numbers. The noise of a joint is raised to its residual torque where that exceeds
    /// the noise of training, because the law is worse there or positions were smoothed.
    pub fn fit_with(
        &self,
        regression: &Regression,
        recorded: &Recorded<'_>,
        bounds: Bounds,
    ) -> Posterior {
        let least = self.noise(recorded);
        let mut noise = least.clone();
        let mut posterior = regression.of_possible(&self.prior, &noise, bounds);
        let repeated = self.repeated(recorded);
        for _ in 0..NOISE_ROUNDS {
            for (joint, noise) in noise.iter_mut().enumerate() {
                let left_over = regression.left_over(joint, &posterior.mean);
                *noise = least[joint].max(repeated * left_over);
            }
            posterior = regression.of_possible(&self.prior, &noise, bounds);
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

    /// The equations of a context.
    pub fn equations_with(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
    ) -> Equations {
        match instructions {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => F32x16::equations(self, recorded),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => F32x8::equations(self, recorded),
            InstructionSet::Portable => F32Array::<8>::equations(self, recorded),
        }
    }

    fn regression_with(&self, instructions: InstructionSet, recorded: &Recorded<'_>) -> Regression {
        match instructions {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => F32x16::regression(self, recorded),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => F32x8::regression(self, recorded),
            InstructionSet::Portable => F32Array::<8>::regression(self, recorded),
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
pub(super) fn narrow(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}

/// The computations that are compiled once per lane type.
trait Predictions: simd::Lanes {
    fn regression(law: &Law, recorded: &Recorded<'_>) -> Regression;
    fn equations(law: &Law, recorded: &Recorded<'_>) -> Equations;
    fn roll(law: &Law, robots: &[Start<'_>]) -> Rolled;
    fn least_pivot(law: &Law, recorded: &Recorded<'_>, numbers: &[f32]) -> f32;
}

macro_rules! predictions {
    ($lanes:ty $(, $features:literal)?) => {
        impl Predictions for $lanes {
            fn regression(
                law: &Law,
                recorded: &Recorded<'_>,
            ) -> Regression {
                $(#[target_feature(enable = $features)])?
                fn compiled(
                    law: &Law,
                    recorded: &Recorded<'_>,
                ) -> Regression {
                    law.regression::<$lanes>(recorded)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(law, recorded)
                }
            }

            fn equations(law: &Law, recorded: &Recorded<'_>) -> Equations {
                $(#[target_feature(enable = $features)])?
                fn compiled(law: &Law, recorded: &Recorded<'_>) -> Equations {
                    law.kept_equations::<$lanes>(recorded)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(law, recorded)
                }
            }

            fn roll(law: &Law, robots: &[Start<'_>]) -> Rolled {
                $(#[target_feature(enable = $features)])?
                fn compiled(law: &Law, robots: &[Start<'_>]) -> Rolled {
                    law.roll::<$lanes>(robots)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(law, robots)
                }
            }

            fn least_pivot(law: &Law, recorded: &Recorded<'_>, numbers: &[f32]) -> f32 {
                $(#[target_feature(enable = $features)])?
                fn compiled(law: &Law, recorded: &Recorded<'_>, numbers: &[f32]) -> f32 {
                    law.least_pivot::<$lanes>(recorded, numbers)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(law, recorded, numbers)
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
predictions!(F32x16, "avx512f,avx512dq,avx512vl,avx2,fma");
#[cfg(target_arch = "x86_64")]
predictions!(F32x8, "avx2,fma");
predictions!(F32Array<8>);
