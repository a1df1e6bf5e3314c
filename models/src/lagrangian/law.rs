//! Predictions of the law: a fit to the context, then one step per sample of the horizon.
//!
//! Everything is computed on the processor, many at once in the lanes of its vectors: samples while a
//! robot's dampings are fitted, robots while they move. Lanes of every width give the same bits, and a robot
//! has the same answer whatever it is asked together with.

#![expect(
    clippy::needless_range_loop,
    reason = "closures do not inline into functions compiled for other instructions; loops over indices do"
)]

use rayon::prelude::*;
use simd::{F32Array, InstructionSet, Lanes, MAX_LANES};
#[cfg(target_arch = "x86_64")]
use simd::{F32x8, F32x16};
use spec::MAX_JOINTS;

use super::dense::{Dense, TILE, bounded, tanh};
use super::factored::Factored;
use super::fit::{Prior, Sums};
use super::motion::{Recorded, products};

/// Times that the products of velocities are computed anew within a sampling time, each time from the
/// velocity after it that the last time gave.
const SWEEPS: usize = 3;

/// The fastest that a joint is let turn, rad/s, ten times what arms do: of a motion that the law does not
/// know, products of velocities could drive it on and on.
const FASTEST: f32 = 50.0;

/// A trained law, ready to predict.
#[derive(Debug)]
pub(super) struct Law {
    layers: Vec<Dense>,
    priors: Vec<Prior>,
    /// The first joint whose angle the network sees.
    first: usize,
    /// Added to the diagonal of the mass matrix, kg m².
    least_inertia: f32,
}

/// Numbers of the network at one pose of every lane.
struct Pose<L> {
    /// Numbers of a layer and of the next, in turns.
    layers: [Vec<L>; 2],
    /// Which of them holds the last.
    last: usize,
}

/// A robot where its context ends.
#[derive(Clone, Copy, Debug)]
struct Start<'a> {
    recorded: Recorded<'a>,
    damping: [f32; MAX_JOINTS],
}

impl Law {
    pub fn new(layers: Vec<Dense>, priors: Vec<Prior>, first: usize, least_inertia: f32) -> Self {
        Self { layers, priors, first, least_inertia }
    }

    /// Positions of the horizons, `[robot, sample, joint]`, rad.
    pub fn predict(&self, robots: &[Recorded<'_>]) -> Vec<f32> {
        self.predict_with(InstructionSet::best(), robots)
    }

    /// As [`Law::predict`], with instructions of one's choice and the same result.
    pub fn predict_with(&self, instructions: InstructionSet, robots: &[Recorded<'_>]) -> Vec<f32> {
        let damping = self.dampings(instructions, robots);
        self.roll_out(instructions, robots, damping)
    }

    /// As [`Law::predict_with`], of robots whose dampings are known.
    pub fn roll_out(
        &self,
        instructions: InstructionSet,
        robots: &[Recorded<'_>],
        damping: Vec<[f32; MAX_JOINTS]>,
    ) -> Vec<f32> {
        let starts: Vec<Start<'_>> = robots
            .iter()
            .zip(damping)
            .map(|(&recorded, damping)| Start { recorded, damping })
            .collect();
        let groups: Vec<Vec<f32>> = starts
            .par_chunks(MAX_LANES)
            .map(|group| match instructions {
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512(_) => F32x16::predict(self, group),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2(_) => F32x8::predict(self, group),
                InstructionSet::Portable => F32Array::<8>::predict(self, group),
            })
            .collect();
        groups.concat()
    }

    /// The dampings of each robot, N·m·s/rad. Questions after one past that follow one another, as a planner
    /// asks them, are fitted once.
    pub fn dampings(
        &self,
        instructions: InstructionSet,
        robots: &[Recorded<'_>],
    ) -> Vec<[f32; MAX_JOINTS]> {
        let asked: Vec<&[Recorded<'_>]> = robots.chunk_by(Recorded::has_the_past_of).collect();
        let fitted: Vec<[f32; MAX_JOINTS]> = asked
            .par_iter()
            .map(|same| match instructions {
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512(_) => F32x16::fit(self, &same[0]),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2(_) => F32x8::fit(self, &same[0]),
                InstructionSet::Portable => F32Array::<8>::fit(self, &same[0]),
            })
            .collect();
        let each = asked.iter().zip(fitted);
        each.flat_map(|(same, damping)| std::iter::repeat_n(damping, same.len())).collect()
    }

    pub fn priors(&self) -> &[Prior] {
        &self.priors
    }

    fn joints(&self) -> usize {
        self.priors.len()
    }

    /// Room for the numbers of the widest layer.
    #[inline(always)]
    fn pose<L: Lanes>(&self) -> Pose<L> {
        let width = self.layers.iter().map(|layer| layer.inputs.max(layer.outputs)).max();
        let room = width.unwrap_or(0).next_multiple_of(TILE);
        Pose { layers: [(); 2].map(|()| vec![L::splat(0.0); room]), last: 0 }
    }

    /// The network at the angles `q`.
    #[inline(always)]
    fn look<L: Lanes>(&self, q: &[L; MAX_JOINTS], pose: &mut Pose<L>) {
        let seen = self.joints() - self.first;
        for input in 0..seen {
            let (sin, cos) = q[self.first + input].sin_cos();
            pose.layers[0][input] = sin;
            pose.layers[0][seen + input] = cos;
        }
        pose.last = 0;
        for (number, layer) in self.layers.iter().enumerate() {
            let [even, odd] = &mut pose.layers;
            let (x, y) = if pose.last == 0 { (even, odd) } else { (odd, even) };
            layer.apply(x, y);
            pose.last = 1 - pose.last;
            if number + 1 < self.layers.len() {
                for y in &mut y[..layer.outputs] {
                    *y = tanh(*y);
                }
            }
        }
    }

    /// The mass matrix times `acceleration`, N·m.
    #[inline(always)]
    fn inertia<L: Lanes>(&self, pose: &Pose<L>, acceleration: &[L; MAX_JOINTS]) -> [L; MAX_JOINTS] {
        let joints = self.joints();
        let factor = pose.factor(joints);
        let mut along = [L::splat(0.0); MAX_JOINTS];
        for row in 0..joints {
            for column in 0..joints {
                let entry = factor[row * joints + column];
                along[column] = entry.mul_add(acceleration[row], along[column]);
            }
        }
        let mut torques = [L::splat(0.0); MAX_JOINTS];
        for row in 0..joints {
            let mut sum = L::splat(f64::from(self.least_inertia)) * acceleration[row];
            for column in 0..joints {
                sum = factor[row * joints + column].mul_add(along[column], sum);
            }
            torques[row] = sum;
        }
        torques
    }

    /// Torques that are quadratic in `velocity`, N·m.
    #[inline(always)]
    fn coriolis<L: Lanes>(&self, pose: &Pose<L>, velocity: &[L; MAX_JOINTS]) -> [L; MAX_JOINTS] {
        let joints = self.joints();
        let pairs = products(joints);
        let coefficients = pose.coefficients(joints);
        let mut torques = [L::splat(0.0); MAX_JOINTS];
        let mut pair = 0;
        for first in 0..joints {
            for second in first..joints {
                let product = velocity[first] * velocity[second];
                for joint in 0..joints {
                    let coefficient = coefficients[joint * pairs + pair];
                    torques[joint] = coefficient.mul_add(product, torques[joint]);
                }
                pair += 1;
            }
        }
        torques
    }

    /// `M · rate + share · damping`, factored.
    #[inline(always)]
    fn factored<L: Lanes>(
        &self,
        pose: &Pose<L>,
        rate: L,
        damping: &[L; MAX_JOINTS],
    ) -> Factored<L> {
        let joints = self.joints();
        let factor = pose.factor(joints);
        let mut matrix = [[L::splat(0.0); MAX_JOINTS]; MAX_JOINTS];
        for row in 0..joints {
            for column in 0..=row {
                let mut sum = L::splat(0.0);
                for inner in 0..joints {
                    let entry = factor[row * joints + inner];
                    sum = entry.mul_add(factor[column * joints + inner], sum);
                }
                matrix[row][column] = sum * rate;
            }
            let share = L::splat(f64::from(self.priors[row].share));
            let least = L::splat(f64::from(self.least_inertia)) * rate;
            matrix[row][row] = share.mul_add(damping[row], matrix[row][row] + least);
        }
        Factored::new(joints, matrix)
    }

    /// The most likely dampings of a robot given its context.
    #[inline(always)]
    fn fit<L: Lanes>(&self, recorded: &Recorded<'_>) -> [f32; MAX_JOINTS] {
        let joints = self.joints();
        let mut pose = self.pose::<L>();
        let mut sums = [Sums::default(); MAX_JOINTS];
        let mut sample = 1;
        while sample + 1 < recorded.samples() {
            let lanes = L::LANES.min(recorded.samples() - 1 - sample);
            let mut gathered = [[[0.0; MAX_LANES]; MAX_JOINTS]; 3];
            for lane in 0..lanes {
                for joint in 0..joints {
                    let motion = recorded.motion(sample + lane, joint);
                    gathered[0][joint][lane] = recorded.y[(sample + lane) * joints + joint];
                    gathered[1][joint][lane] = motion.change * recorded.rate_hz;
                    gathered[2][joint][lane] = 0.5_f32.mul_add(motion.change, motion.velocity);
                }
            }
            let [mut q, mut acceleration, mut velocity] = [[L::splat(0.0); MAX_JOINTS]; 3];
            for joint in 0..joints {
                q[joint] = L::load(&gathered[0][joint]);
                acceleration[joint] = L::load(&gathered[1][joint]);
                velocity[joint] = L::load(&gathered[2][joint]);
            }
            self.look(&q, &mut pose);
            let inertia = self.inertia(&pose, &acceleration);
            let coriolis = self.coriolis(&pose, &velocity);
            for joint in 0..joints {
                let mut inertial = [0.0; MAX_LANES];
                (inertia[joint] + coriolis[joint]).store(&mut inertial);
                for lane in 0..lanes {
                    let motion = recorded.motion(sample + lane, joint);
                    sums[joint].add(self.priors[joint].share, motion, inertial[lane]);
                }
            }
            sample += lanes;
        }
        let mut damping = [0.0; MAX_JOINTS];
        for joint in 0..joints {
            damping[joint] = self.priors[joint].damping(&sums[joint]);
        }
        damping
    }

    /// Positions of the horizons of at most [`MAX_LANES`] robots, `[robot, sample, joint]`, rad.
    #[inline(always)]
    fn roll<L: Lanes>(&self, robots: &[Start<'_>]) -> Vec<f32> {
        let joints = self.joints();
        let Some(Start { recorded, .. }) = robots.first() else { return Vec::new() };
        let (context, samples) = (recorded.samples(), recorded.u.len() / joints);
        let horizon = samples - context;
        let mut answer = vec![0.0; robots.len() * horizon * joints];
        for (group, answer) in
            robots.chunks(L::LANES).zip(answer.chunks_mut(L::LANES * horizon * joints))
        {
            let mut starts = [[[0.0; MAX_LANES]; MAX_JOINTS]; 3];
            // From the sample before the context's last one on.
            let mut torques = vec![[[0.0; MAX_LANES]; MAX_JOINTS]; horizon + 1];
            for (lane, Start { recorded, damping }) in group.iter().enumerate() {
                for joint in 0..joints {
                    starts[0][joint][lane] = recorded.y[(context - 1) * joints + joint];
                    starts[1][joint][lane] = recorded.last_velocity(joint);
                    starts[2][joint][lane] = damping[joint];
                    for (step, torques) in torques.iter_mut().enumerate() {
                        let sample = (context + step).saturating_sub(2);
                        torques[joint][lane] = recorded.u[sample * joints + joint];
                    }
                }
            }
            let [mut q, mut velocity, mut damping] = [[L::splat(0.0); MAX_JOINTS]; 3];
            for joint in 0..joints {
                q[joint] = L::load(&starts[0][joint]);
                velocity[joint] = L::load(&starts[1][joint]);
                damping[joint] = L::load(&starts[2][joint]);
            }
            let rate = L::splat(f64::from(recorded.rate_hz));
            let period = rate.recip();
            let mut pose = self.pose::<L>();
            for step in 0..horizon {
                self.look(&q, &mut pose);
                let factored = self.factored(&pose, rate, &damping);
                // All torques that change the velocity, but for products of velocities.
                let mut driving = [L::splat(0.0); MAX_JOINTS];
                for joint in 0..joints {
                    let share = L::splat(f64::from(self.priors[joint].share));
                    let before = L::load(&torques[step][joint]);
                    let after = L::load(&torques[step + 1][joint]);
                    let torque = share.mul_add(after - before, before);
                    driving[joint] = damping[joint].neg_mul_add(velocity[joint], torque);
                }
                let mut change = [L::splat(0.0); MAX_JOINTS];
                for _ in 0..SWEEPS {
                    let mut between = velocity;
                    for joint in 0..joints {
                        between[joint] = L::splat(0.5).mul_add(change[joint], velocity[joint]);
                    }
                    let coriolis = self.coriolis(&pose, &between);
                    for joint in 0..joints {
                        change[joint] = driving[joint] - coriolis[joint];
                    }
                    factored.solve(joints, &mut change);
                    for joint in 0..joints {
                        let after = bounded(velocity[joint] + change[joint], FASTEST);
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
        }
        answer
    }
}

impl<L> Pose<L> {
    /// A, `[row, column]`.
    #[inline(always)]
    fn factor(&self, joints: usize) -> &[L] {
        &self.layers[self.last][..joints * joints]
    }

    /// C, `[joint, product]`.
    #[inline(always)]
    fn coefficients(&self, joints: usize) -> &[L] {
        &self.layers[self.last][joints * joints..][..joints * products(joints)]
    }
}

/// The computations that are compiled once per lane type.
trait Predictions: Lanes {
    fn fit(law: &Law, recorded: &Recorded<'_>) -> [f32; MAX_JOINTS];
    fn predict(law: &Law, robots: &[Start<'_>]) -> Vec<f32>;
}

macro_rules! predictions {
    ($lanes:ty $(, $features:literal)?) => {
        impl Predictions for $lanes {
            fn fit(law: &Law, recorded: &Recorded<'_>) -> [f32; MAX_JOINTS] {
                $(#[target_feature(enable = $features)])?
                fn compiled(law: &Law, recorded: &Recorded<'_>) -> [f32; MAX_JOINTS] {
                    law.fit::<$lanes>(recorded)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(law, recorded)
                }
            }

            fn predict(law: &Law, robots: &[Start<'_>]) -> Vec<f32> {
                $(#[target_feature(enable = $features)])?
                fn compiled(law: &Law, robots: &[Start<'_>]) -> Vec<f32> {
                    law.roll::<$lanes>(robots)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(law, robots)
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
