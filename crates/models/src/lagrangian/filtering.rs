//! Predictions from noisy positions: a Kalman filter with the learned law as its motion.
//!
//! First, positions are smoothed joint by joint and without the law ([`Smoother`]), and the
//! robot's numbers are fitted to the result. Around this motion the law is linear. Forward
//! differences, which are lanes of one call, give the change of the next state with angles,
//! velocities, dampings and torques. A Kalman filter over the context then estimates angles,
//! velocities and dampings together from the measured positions. The prediction begins at its last
//! state, with its dampings.
//!
//! The filter treats the law's errors as white noise of torques, a multiple of the noise that
//! training found. It chooses, for each robot, the multiple under which the context is most likely.
//! Errors of a law are not white, and they are larger on data unlike its training's. The multiple also
//! says how much of the torques that the law leaves of a smoothed motion is its own error. The rest is
//! what smoothing leaves of the noise. It moves nothing, and it averages out in a fit. So numbers are
//! fitted once more as if it were not there, and the context is filtered once more with these.

use nalgebra::{Cholesky, DMatrix};
use series::{MeasurementNoise, Smoother};
use simd::InstructionSet;

use super::fitting::{RobotPosterior, State};
use super::law::{JointLaw, Law, narrow};
use super::recorded::Recorded;
use super::regression::{Bounds, Posterior};
use super::rollout::Start;

/// Smaller noise counts as this, rad, because positions are computed in f32.
const LEAST_NOISE: f64 = 1e-6;
/// A shorter context, in samples, is not filtered.
const LEAST_SAMPLES: usize = 8;

/// Perturbations of the forward differences: rad, rad/s, share of the mean damping, N·m. They are
/// far above rounding, which is 1e-5 rad/s.
const ANGLE: f32 = 0.01;
const VELOCITY: f32 = 0.05;
const DAMPING: f32 = 0.05;
const TORQUE: f32 = 0.1;

/// Standard deviation of the velocity at the first sample around that of the smoothed positions,
/// rad/s.
const INITIAL_VELOCITY: f64 = 1.0;
/// Standard deviation of the angle at the first sample, in standard deviations of the measurement.
const INITIAL_ANGLE: f64 = 10.0;

/// Rounding error of a step of the law, rad/s.
const ROUNDING: f64 = 2e-5;

/// The ratio of two neighbouring noise multiples that the filter tries, and their number on either
/// side of training's noise.
const RATIO: f64 = 3.0;
const STEPS: i32 = 6;

/// The findings of a filter about a context of noisy positions.
#[derive(Debug)]
pub(super) struct FilteredContext {
    /// Smoothed positions, to which the robot's numbers were fitted.
    pub smoothed: Vec<f32>,
    /// A root of the covariance at the end of the context, `[row, column]`: the angles in rad, then
    /// the velocities in rad/s.
    pub motion: DMatrix<f64>,
    /// Standard deviation of the law's own errors in each joint, as the measured positions show it, but
    /// no less than in training, N·m.
    pub law_errors: Vec<f32>,
}

/// Whether a context is long enough, and noisy enough, to be filtered.
pub(super) fn is_filtered(robot: &Recorded<'_>, noise: MeasurementNoise) -> bool {
    noise.position_rad > 0.0 && robot.samples() >= LEAST_SAMPLES
}

impl Law {
    /// Identifies the robot of a context of noisy positions.
    pub fn identify_filtered(
        &self,
        instructions: InstructionSet,
        robot: &Recorded<'_>,
        smoother: &Smoother,
        noise: MeasurementNoise,
        bounds: Bounds,
    ) -> RobotPosterior {
        let smoothed = smoother.smooth_robot(robot.y, robot.joints);
        let path = Recorded { y: &smoothed, ..*robot };
        let regression = self.regression_of(instructions, &path);
        let fit = |most| self.fit_within(instructions, &path, &regression, bounds, most);
        let filtered = |numbers: &Posterior| {
            let numbers = narrow(&numbers.mean);
            let steps = self.linearized(instructions, &path, &numbers);
            let (law, steps) = (self, &steps);
            let filter = Filter { law, measured: robot, path: &path, numbers, steps, noise };
            let (belief, multiple) = filter.most_likely();
            (filter.state(&belief), belief, multiple)
        };
        let (.., multiple) = filtered(&fit(None));
        let numbers = fit(Some(&self.deviations(multiple, noise)));
        let (most_likely, belief, multiple) = filtered(&numbers);
        let width = belief.mean.len();
        let motion = root_of_block(&belief.covariance, width, 2 * robot.joints);
        let exact = MeasurementNoise::default();
        let law_errors = narrow(&self.deviations(multiple.max(1.0), exact));
        let disturbance = self.disturbance(instructions, &path, &numbers.mean);
        let filtered = Some(FilteredContext { smoothed, motion, law_errors });
        RobotPosterior { most_likely, numbers, filtered, disturbance }
    }

    /// The standard deviation of the residual torque of each joint, N·m, where the law's own errors
    /// are a `multiple` of training's.
    fn deviations(&self, multiple: f64, noise: MeasurementNoise) -> Vec<f64> {
        let of_joint =
            |joint: &JointLaw| (multiple * f64::from(joint.noise)).hypot(noise.torque_nm);
        self.joints.iter().map(of_joint).collect()
    }

    /// The steps from sample 1 to the last, each linearized around the path.
    fn linearized(
        &self,
        instructions: InstructionSet,
        path: &Recorded<'_>,
        numbers: &[f32],
    ) -> Vec<Step> {
        let joints = path.joints;
        let variants = 1 + 4 * joints;
        let steps = 1..path.samples() - 1;
        let mut u = Vec::with_capacity(steps.len() * variants * 3 * joints);
        let mut y = Vec::with_capacity(steps.len() * variants * 2 * joints);
        // The robot itself, and the same robot with more damping at each joint.
        let damped = |joint: usize| {
            let mut numbers = numbers.to_vec();
            numbers[self.numbers.dampings()][joint] += DAMPING * self.mean_damping(joint);
            numbers
        };
        let robots: Vec<Vec<f32>> =
            std::iter::once(numbers.to_vec()).chain((0..joints).map(damped)).collect();
        let mut of_variants = Vec::with_capacity(steps.len() * variants);
        for sample in steps {
            let before = (sample - 1) * joints;
            let torques = &path.u[before..before + 2 * joints];
            let positions = &path.y[before..before + 2 * joints];
            for variant in 0..variants {
                let (u_at, y_at) = (u.len(), y.len());
                u.extend_from_slice(torques);
                u.extend_from_slice(&torques[joints..]);
                y.extend_from_slice(positions);
                let mut robot = 0;
                if let Some(change) = variant.checked_sub(1) {
                    let joint = change % joints;
                    match change / joints {
                        // The same velocity at another angle.
                        0 => {
                            y[y_at + joint] += ANGLE;
                            y[y_at + joints + joint] += ANGLE;
                        }
                        1 => y[y_at + joint] -= VELOCITY / path.rate_hz,
                        2 => robot = 1 + joint,
                        _ => {
                            u[u_at + joint] += TORQUE;
                            u[u_at + joints + joint] += TORQUE;
                        }
                    }
                }
                of_variants.push(robot);
            }
        }
        let starts = u.chunks_exact(3 * joints).zip(y.chunks_exact(2 * joints));
        let starts: Vec<Start<'_>> = starts
            .zip(of_variants)
            .map(|((u, y), robot)| Start {
                recorded: Recorded { u, y, ..*path },
                numbers: &robots[robot],
            })
            .collect();
        let next = self.roll_out(instructions, &starts).positions;
        let each = y.chunks_exact(variants * 2 * joints).zip(next.chunks_exact(variants * joints));
        let changes = |variant: usize| match variant / joints {
            0 => f64::from(ANGLE),
            1 => f64::from(VELOCITY),
            2 => f64::from(DAMPING * self.mean_damping(variant % joints)),
            _ => f64::from(TORQUE),
        };
        each.map(|(y, next)| Step::new(y, next, joints, f64::from(path.rate_hz), changes)).collect()
    }

    /// The mean over robots, N·m·s/rad.
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    fn mean_damping(&self, joint: usize) -> f32 {
        self.prior.mean[self.numbers.dampings()][joint] as f32
    }
}

/// A smoother for the context of `robot`.
pub(super) fn smoother(robot: &Recorded<'_>, noise: MeasurementNoise) -> Smoother {
    let deviation = noise.position_rad.max(LEAST_NOISE);
    Smoother::new(robot.samples(), f64::from(robot.rate_hz), deviation)
}

/// The filter of a robot's context.
struct Filter<'a> {
    law: &'a Law,
    measured: &'a Recorded<'a>,
    /// The motion that steps are linear about.
    path: &'a Recorded<'a>,
    numbers: Vec<f32>,
    steps: &'a [Step],
    noise: MeasurementNoise,
}

impl Filter<'_> {
    /// The belief at the end of the context, for the tried noise multiple under which the context is
    /// most likely, and the most likely multiple. That may lie between those that are tried, and is
    /// infinite beyond the largest.
    fn most_likely(&self) -> (Belief, f64) {
        let run = |step: i32| self.run(RATIO.powi(step));
        let (mut step, mut best) = (0_i32, run(0));
        // The likelihoods one step below and above the best.
        let mut beside = [None; 2];
        for (side, direction) in [(1, 1), (0, -1)] {
            while beside[side].is_none() && (step + direction).abs() <= STEPS {
                let found = run(step + direction);
                if found.negative_log_likelihood < best.negative_log_likelihood {
                    beside[1 - side] = Some(best.negative_log_likelihood);
                    (step, best) = (step + direction, found);
                } else {
                    beside[side] = Some(found.negative_log_likelihood);
                }
            }
        }
        let between = match beside {
            [Some(below), Some(above)] => lowest(below, best.negative_log_likelihood, above),
            // The law's errors are at least as large as the largest that are tried.
            [_, None] => f64::INFINITY,
            _ => 0.0,
        };
        (best, RATIO.powf(f64::from(step) + between))
    }

    /// Runs the filter with the law's torque noise `scale` times that of training.
    fn run(&self, scale: f64) -> Belief {
        let joints = self.measured.joints;
        let mut belief = self.prior();
        belief.measure(&self.innovations(1), joints, self.variance(1));
        let deviations = self.law.deviations(scale, self.noise);
        let mut room = vec![0.0; 6 * joints * joints];
        for (sample, step) in (2..).zip(self.steps) {
            belief.advance(
                step,
                &self.at(sample),
                &deviations,
                f64::from(self.path.rate_hz),
                &mut room,
            );
            belief.measure(&self.innovations(sample), joints, self.variance(sample));
        }
        belief
    }

    /// The variance of the measured position at a sample, rad².
    fn variance(&self, sample: usize) -> f64 {
        let is_last = sample + 1 == self.path.samples();
        let MeasurementNoise { position_rad, last_position_rad, .. } = self.noise;
        let deviation = if is_last { last_position_rad } else { position_rad };
        deviation.max(LEAST_NOISE).powi(2)
    }

    fn prior(&self) -> Belief {
        let joints = self.measured.joints;
        let width = 3 * joints;
        let mut belief = Belief {
            mean: vec![0.0; width],
            covariance: vec![0.0; width * width],
            negative_log_likelihood: 0.0,
        };
        let dampings = self.law.numbers.dampings();
        let fitted = &self.numbers[dampings.clone()];
        for (joint, number) in dampings.enumerate() {
            let prior = &self.law.prior;
            belief.mean[2 * joints + joint] = prior.mean[number] - f64::from(fitted[joint]);
            let variances = [
                INITIAL_ANGLE.powi(2) * self.variance(1),
                INITIAL_VELOCITY.powi(2),
                prior.spread[number].powi(2),
            ];
            for (group, variance) in variances.into_iter().enumerate() {
                belief.covariance[(group * joints + joint) * (width + 1)] = variance;
            }
        }
        belief
    }

    /// Measured positions minus the path's positions.
    fn innovations(&self, sample: usize) -> Vec<f64> {
        let joints = self.measured.joints;
        let at = sample * joints..(sample + 1) * joints;
        let pairs = self.measured.y[at.clone()].iter().zip(&self.path.y[at]);
        pairs.map(|(measured, path)| f64::from(*measured) - f64::from(*path)).collect()
    }

    /// Angles and velocities of the path.
    fn at(&self, sample: usize) -> Vec<f64> {
        let joints = self.path.joints;
        let angle = |sample: usize, joint: usize| f64::from(self.path.y[sample * joints + joint]);
        let rate_hz = f64::from(self.path.rate_hz);
        let velocity = |joint| rate_hz * (angle(sample, joint) - angle(sample - 1, joint));
        (0..joints).map(|joint| angle(sample, joint)).chain((0..joints).map(velocity)).collect()
    }

    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    fn state(&self, belief: &Belief) -> State {
        let joints = self.measured.joints;
        let path = self.at(self.path.samples() - 1);
        let finite = belief.mean.iter().all(|more| more.is_finite());
        let mean = if finite { belief.mean.clone() } else { vec![0.0; belief.mean.len()] };
        let state: Vec<f64> = path.iter().zip(&mean).map(|(path, more)| path + more).collect();
        let period = 1.0 / f64::from(self.path.rate_hz);
        let before = (0..joints).map(|joint| state[joint] - period * state[joints + joint]);
        let y: Vec<f32> = before.chain(state[..joints].iter().copied()).map(|q| q as f32).collect();
        let mut numbers = self.numbers.clone();
        let dampings = &mut numbers[self.law.numbers.dampings()];
        for (damping, more) in dampings.iter_mut().zip(&mean[2 * joints..]) {
            *damping = (*damping + *more as f32).max(0.0);
        }
        State { y, numbers }
    }
}

/// A step of the law, linearized around a state of the path. The state has angles and velocities.
struct Step {
    /// The state that the law predicts from the path, before the path's next state is subtracted:
    /// angles in rad, then velocities in rad/s.
    defect: Vec<f64>,
    /// `[angle or velocity, angle or velocity or damping]`.
    transition: Vec<f64>,
    /// `[angle or velocity, torque]`.
    torque: Vec<f64>,
}

impl Step {
    /// Builds the step from the last two positions of each variant and from the position after
    /// them. `change` is the perturbation of each variant except the first.
    fn new(
        y: &[f32],
        next: &[f32],
        joints: usize,
        rate_hz: f64,
        change: impl Fn(usize) -> f64,
    ) -> Self {
        let after = |variant: usize, place: usize| {
            let joint = place % joints;
            let angle = f64::from(next[variant * joints + joint]);
            if place < joints {
                return angle;
            }
            rate_hz * (angle - f64::from(y[variant * 2 * joints + joints + joint]))
        };
        let mut step = Self {
            defect: (0..2 * joints).map(|place| after(0, place)).collect(),
            transition: Vec::with_capacity(6 * joints * joints),
            torque: Vec::with_capacity(2 * joints * joints),
        };
        for place in 0..2 * joints {
            let slope =
                |variant: usize| (after(1 + variant, place) - after(0, place)) / change(variant);
            step.transition.extend((0..3 * joints).map(slope));
            step.torque.extend((3 * joints..4 * joints).map(slope));
        }
        step
    }
}

/// Estimate and covariance of the difference to the path: angles, velocities, dampings.
struct Belief {
    mean: Vec<f64>,
    /// `[row, column]`
    covariance: Vec<f64>,
    /// The negative log-likelihood so far, up to a constant.
    negative_log_likelihood: f64,
}

impl Belief {
    /// Predicts over a step. The path is at `path` where the step ends.
    fn advance(
        &mut self,
        step: &Step,
        path: &[f64],
        deviations: &[f64],
        rate_hz: f64,
        room: &mut [f64],
    ) {
        let (joints, width) = (deviations.len(), self.mean.len());
        let active = 2 * joints;
        let rows = || step.transition.chunks_exact(width);
        let mean: Vec<f64> = rows()
            .zip(&step.defect)
            .zip(path)
            .map(|((row, led), path)| led - path + dot(row, &self.mean))
            .collect();
        self.mean[..active].copy_from_slice(&mean);
        // The transition matrix times the covariance, which is symmetric.
        for (row, room) in rows().zip(room.chunks_exact_mut(width)) {
            room.fill(0.0);
            for (&factor, covariance) in row.iter().zip(self.covariance.chunks_exact(width)) {
                for (sum, entry) in room.iter_mut().zip(covariance) {
                    *sum += factor * entry;
                }
            }
        }
        for (row, moved) in room.chunks_exact(width).enumerate() {
            for (column, factors) in rows().enumerate().take(row + 1) {
                let torques = step.torque[row * joints..][..joints]
                    .iter()
                    .zip(&step.torque[column * joints..][..joints]);
                let noise = torques
                    .zip(deviations)
                    .map(|((a, b), deviation)| a * b * deviation * deviation);
                let mut entry = dot(moved, factors) + noise.sum::<f64>();
                if row == column {
                    let rounding = if row < joints { ROUNDING / rate_hz } else { ROUNDING };
                    entry += rounding * rounding;
                }
                self.covariance[row * width + column] = entry;
                self.covariance[column * width + row] = entry;
            }
            for (column, &entry) in moved.iter().enumerate().skip(active) {
                self.covariance[row * width + column] = entry;
                self.covariance[column * width + row] = entry;
            }
        }
    }

    /// Updates with the measured position of each joint, one after the other.
    fn measure(&mut self, innovations: &[f64], joints: usize, variance: f64) {
        let width = self.mean.len();
        let mut gain = vec![0.0; width];
        for (joint, measured) in innovations.iter().enumerate().take(joints) {
            gain.copy_from_slice(&self.covariance[joint * width..][..width]);
            let total = gain[joint] + variance;
            let innovation = measured - self.mean[joint];
            self.negative_log_likelihood += 0.5 * (total.ln() + innovation * innovation / total);
            for row in 0..width {
                let share = gain[row] / total;
                self.mean[row] += share * innovation;
                for (entry, other) in self.covariance[row * width..][..width].iter_mut().zip(&gain)
                {
                    *entry -= share * other;
                }
            }
        }
    }
}

/// A root of the block of the first `size` rows of a covariance of `width` rows.
fn root_of_block(covariance: &[f64], width: usize, size: usize) -> DMatrix<f64> {
    let block = DMatrix::from_fn(size, size, |row, column| covariance[row * width + column]);
    Cholesky::new(block).map_or_else(|| DMatrix::zeros(size, size), Cholesky::unpack)
}

/// The place where a parabola through the values at -1, 0 and 1 is lowest, if the middle one is least of
/// them; 0 for values that are not finite.
fn lowest(below: f64, middle: f64, above: f64) -> f64 {
    let bend = below - 2.0 * middle + above;
    let at = 0.5 * (below - above) / bend;
    if at.is_finite() { at.clamp(-0.5, 0.5) } else { 0.0 }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::lowest;

    #[test]
    fn a_parabola_is_lowest_between_its_values() {
        for at in [-0.4, 0.0, 0.25] {
            let [below, middle, above] =
                [-1.0, 0.0, 1.0].map(|x: f64| 3.0 + 2.0 * (x - at).powi(2));
            assert!((lowest(below, middle, above) - at).abs() < 1e-12, "{at}");
        }
        assert_eq!(lowest(1.0, 1.0, 1.0), 0.0);
        assert_eq!(lowest(f64::NAN, 1.0, 2.0), 0.0);
    }
}
