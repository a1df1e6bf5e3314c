//! The fit of a robot to how far it moves in short stretches of its context.
//!
//! A torque that the law does not explain moves a joint the farther, the longer it lasts. A
//! regression of torques takes the residuals of all samples as independent, so it counts a slow error
//! as little as a fast one. Here the equations of a stretch are solved for accelerations, with the
//! mass matrix of the robot that the torques say, and summed twice over time. The residual is then
//! how far the robot is from where the law leads it from the beginning of the stretch, to first
//! order. It is still linear in the numbers of the robot.

use nalgebra::DMatrix;
use simd::{InstructionSet, Kernel, Lanes, MAX_LANES, with_f32_lanes};
use spec::MAX_JOINTS;

use super::fitting::NOISE_ROUNDS;
use super::law::{Law, narrow};
use super::linear_algebra::Factored;
use super::pose::Pose;
use super::recorded::Recorded;
use super::regression::{Bounds, Equations, NormalEquations, Posterior};

fn env(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(default)
}

/// The equations of stretches, of all joints and several times from the beginning of a stretch.
struct Displacements {
    /// Numbers of a robot.
    count: usize,
    /// `[row, number + 1]`: factors, and the displacement on the right-hand side, rad.
    rows: Vec<f64>,
    /// The joint and the time within its stretch of each row, as one index.
    groups: Vec<usize>,
}

impl Law {
    /// The distribution of a robot's numbers given its displacements. `first` is what the torques
    /// say.
    pub fn fit_stretches(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        first: Posterior,
        bounds: Bounds,
    ) -> Posterior {
        let equations = self.equations_of(instructions, recorded);
        let accelerations = self.accelerations(instructions, recorded, &equations, &first.mean);
        let rows = Displacements::new(self, recorded, &accelerations);
        if rows.groups.is_empty() {
            return first;
        }
        let mut found = first;
        for _ in 0..NOISE_ROUNDS {
            let noise = rows.residuals(&found.mean);
            found =
                rows.normal_equations(&noise).bounded_posterior(self.numbers, &self.prior, bounds);
        }
        found
    }

    /// The equations, solved for accelerations, `[sample, joint, number + 1]`.
    fn accelerations(
        &self,
        instructions: InstructionSet,
        recorded: &Recorded<'_>,
        equations: &Equations,
        numbers: &[f64],
    ) -> Vec<f64> {
        let (law, joints, count) = (self, self.numbers.joints, self.numbers.count());
        let numbers = narrow(numbers);
        let inverses = with_f32_lanes!(instructions, L => L::run(Inverses { law, recorded, numbers: &numbers }));
        let mut solved = vec![0.0; equations.samples() * joints * (count + 1)];
        let mut row = vec![0.0; count + 1];
        for (index, equation) in equations.of(0..equations.samples()).enumerate() {
            let (sample, joint) = (index / joints, index % joints);
            equation.write(self.numbers, &mut row);
            let inverse = &inverses[sample * joints * joints..][..joints * joints];
            for (other, solved) in solved[sample * joints * (count + 1)..][..joints * (count + 1)]
                .chunks_exact_mut(count + 1)
                .enumerate()
            {
                let factor = f64::from(inverse[other * joints + joint]);
                for (sum, value) in solved.iter_mut().zip(&row) {
                    *sum += factor * value;
                }
            }
        }
        solved
    }
}

impl Displacements {
    fn new(law: &Law, recorded: &Recorded<'_>, accelerations: &[f64]) -> Self {
        let (joints, count) = (law.numbers.joints, law.numbers.count());
        let width = joints * (count + 1);
        let samples = accelerations.len() / width;
        let rate_hz = f64::from(recorded.rate_hz);
        let length = ((env("TQ_STRETCH", 0.333) * rate_hz).round() as usize).max(1);
        let every = ((env("TQ_EVERY", 0.0667) * rate_hz).round() as usize).max(1);
        let step = ((env("TQ_STEP", 0.1667) * rate_hz).round() as usize).max(1);
        let mut all = Self { count, rows: Vec::new(), groups: Vec::new() };
        for first in (0..(samples + 1).saturating_sub(length)).step_by(step) {
            let [mut velocity, mut position] = [vec![0.0; width], vec![0.0; width]];
            for sample in 0..length {
                let accelerations = &accelerations[(first + sample) * width..][..width];
                for index in 0..width {
                    velocity[index] += accelerations[index] / rate_hz;
                    position[index] += velocity[index] / rate_hz;
                }
                if (sample + 1) % every == 0 {
                    all.rows.extend(&position);
                    let time = sample / every;
                    all.groups.extend((0..joints).map(|joint| time * joints + joint));
                }
            }
        }
        all
    }

    fn each(&self) -> impl Iterator<Item = (usize, &[f64])> {
        self.groups.iter().copied().zip(self.rows.chunks_exact(self.count + 1))
    }

    /// The root mean square of the residuals of each group.
    fn residuals(&self, numbers: &[f64]) -> Vec<f64> {
        let groups = self.groups.iter().max().map_or(0, |last| last + 1);
        let mut sums = vec![(0.0, 0.0); groups];
        for (group, row) in self.each() {
            let expected: f64 = row.iter().zip(numbers).map(|(a, b)| a * b).sum();
            let off = row[self.count] - expected;
            sums[group].0 += off * off;
            sums[group].1 += 1.0;
        }
        let floor = env("TQ_FLOOR", 1e-5);
        sums.into_iter()
            .map(|(squares, count): (f64, f64)| (squares / count).sqrt().max(floor))
            .collect()
    }

    fn normal_equations(&self, noise: &[f64]) -> NormalEquations {
        let count = self.count;
        let mut squares = DMatrix::zeros(count, count);
        let mut products = vec![0.0; count];
        for (group, row) in self.each() {
            let precision = noise[group].powi(-2) * env("TQ_WEIGHT", 1.0);
            for column in 0..count {
                let weighted = precision * row[column];
                if weighted == 0.0 {
                    continue;
                }
                products[column] += weighted * row[count];
                for below in column..count {
                    squares[(below, column)] += weighted * row[below];
                }
            }
        }
        NormalEquations { squares, products }
    }
}

/// The inverses of the mass matrix, `[sample, joint, joint]`, at the samples that have an equation.
struct Inverses<'a> {
    law: &'a Law,
    recorded: &'a Recorded<'a>,
    numbers: &'a [f32],
}

impl<L: Lanes> Kernel<L> for Inverses<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let Self { law, recorded, numbers } = self;
        let joints = law.numbers.joints;
        let samples = recorded.samples().saturating_sub(2);
        let mut pose = Pose::<L>::new(law);
        let numbers = law.weighed(numbers);
        let numbers: Vec<L> = numbers.iter().map(|&number| L::splat(f64::from(number))).collect();
        let mut armatures = [L::splat(0.0); MAX_JOINTS];
        for joint in 0..joints {
            armatures[joint] = L::splat(f64::from(law.joints[joint].armature));
        }
        let standing = [L::splat(0.0); MAX_JOINTS];
        let mut inverses = vec![0.0; samples * joints * joints];
        for first in (0..samples).step_by(L::LANES) {
            let lanes = L::LANES.min(samples - first);
            let mut gathered = [[0.0; MAX_LANES]; MAX_JOINTS];
            for lane in 0..lanes {
                for joint in 0..joints {
                    gathered[joint][lane] = recorded.y[(1 + first + lane) * joints + joint];
                }
            }
            let mut q = [L::splat(0.0); MAX_JOINTS];
            for joint in 0..joints {
                q[joint] = L::load(&gathered[joint]);
            }
            pose.update(law, &q, &standing);
            let factored = Factored::new(joints, pose.inertia(law, &numbers), &armatures);
            for column in 0..joints {
                let mut x = [L::splat(0.0); MAX_JOINTS];
                x[column] = L::splat(1.0);
                factored.solve(joints, &mut x);
                for row in 0..joints {
                    let mut of_lanes = [0.0; MAX_LANES];
                    x[row].store(&mut of_lanes);
                    for lane in 0..lanes {
                        inverses[((first + lane) * joints + row) * joints + column] =
                            of_lanes[lane];
                    }
                }
            }
        }
        inverses
    }
}
