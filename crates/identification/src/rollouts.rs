//! Simulated motions from measured states, beside the measured motions.

use dynamics::{Joints, Motion as Rollout, Replay, Robot};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use simd::InstructionSet;
use spec::{Integrator, Precision};

use crate::arm::Arm;
use crate::arx::Arx;
use crate::horizons::HORIZONS_S;
use crate::motion::{Motion, whole};
use crate::normal_equations::NormalEquations;
use crate::trace::Trace;

/// The longest step of the integration, s. Coulomb friction bends within a millisecond.
const LONGEST_STEP_S: f64 = 5e-4;

/// The most windows. Their simulations with every number changed are kept in memory: 1 GB at 250 Hz
/// and 7 joints.
const MOST_WINDOWS: usize = 1000;

/// A part of a motion that is predicted.
struct Window<'a> {
    motion: &'a Motion,
    start: usize,
}

/// Parts of motions, and the simulations of an arm through them.
pub(crate) struct Windows<'a> {
    windows: Vec<Window<'a>>,
    joints: usize,
    rate_hz: f64,
    /// Samples of a rollout, the start included.
    length: usize,
    replay: Replay,
}

impl<'a> Windows<'a> {
    /// Windows of the longest horizon, one every `every_s` seconds, or [`MOST_WINDOWS`] evenly. All
    /// motions have the same rate.
    pub(crate) fn new(motions: &'a [Motion], every_s: f64) -> Self {
        let (joints, rate_hz) = (motions[0].joints, motions[0].rate_hz);
        let horizon = motions[0].samples_in(HORIZONS_S[HORIZONS_S.len() - 1]);
        let all_samples: usize = motions.iter().map(Motion::samples).sum();
        let every = motions[0].samples_in(every_s).max(all_samples / MOST_WINDOWS).max(1);
        let windows = motions.iter().flat_map(|motion| {
            let last = motion.samples().saturating_sub(horizon + motion.uncertain() + 1);
            (motion.uncertain()..last).step_by(every).map(move |start| Window { motion, start })
        });
        let substeps = whole((1.0 / (rate_hz * LONGEST_STEP_S)).ceil()).max(1);
        let substeps = u32::try_from(substeps).unwrap_or(u32::MAX);
        Self {
            windows: windows.collect(),
            joints,
            rate_hz,
            length: horizon + 1,
            replay: Replay {
                rate_hz,
                integrator: Integrator::Extrapolated { order: 1, substeps },
                precision: Precision::F32,
                instructions: InstructionSet::best(),
            },
        }
    }

    /// Those through which no torque is cut off.
    pub(crate) fn without_cuts(mut self) -> Self {
        let (length, joints) = (self.length, self.joints);
        let is_cut =
            |motion: &Motion, sample: usize| (0..joints).any(|joint| motion.is_cut(joint, sample));
        self.windows.retain(|Window { motion, start }| {
            !(*start..*start + length).any(|sample| is_cut(motion, sample))
        });
        self
    }

    /// Windows that begin where the one before ends.
    pub(crate) fn back_to_back(motions: &'a [Motion]) -> Self {
        Self::new(motions, HORIZONS_S[HORIZONS_S.len() - 1])
    }

    /// The positions of each joint in all windows of the only motion, beside those of two arms,
    /// degrees.
    pub(crate) fn traces(&self, described: &Arm, identified: &Arm) -> Vec<Trace> {
        let positions = self.positions(&[described.clone(), identified.clone()]);
        let samples = || {
            (0..self.count())
                .flat_map(|window| (0..self.length - 1).map(move |sample| (window, sample)))
        };
        let trace = |joint: usize| {
            let of = |arm: usize| -> Vec<f64> {
                let at = |(window, sample): (usize, usize)| {
                    let place = (window * self.length + sample) * self.joints + joint;
                    f64::from(positions[arm][place]).to_degrees()
                };
                samples().map(at).collect()
            };
            let time = |(window, sample): (usize, usize)| {
                (self.windows[window].start + sample) as f64 / self.rate_hz
            };
            Trace {
                times_s: samples().map(time).collect(),
                measured: samples()
                    .map(|(window, sample)| self.measured(window, sample, joint).to_degrees())
                    .collect(),
                described: of(0),
                identified: of(1),
            }
        };
        (0..self.joints).map(trace).collect()
    }

    pub(crate) fn count(&self) -> usize {
        self.windows.len()
    }

    fn samples_in(&self, seconds: f64) -> usize {
        whole(seconds * self.rate_hz)
    }

    /// Torques through each window without the sensors' gains and offsets, `[window][sample, joint]`.
    #[expect(clippy::cast_possible_truncation, reason = "the lanes take torques in f32")]
    fn torques(&self, arm: &Arm) -> Vec<Vec<f32>> {
        let later_s = arm.delay_s.map_or(0.0, |delay_s| delay_s + 0.5 / self.rate_hz);
        let sensors: Vec<(f64, f64)> = arm.gains().into_iter().zip(arm.offsets_nm()).collect();
        let of = |window: &Window<'_>| -> Vec<f32> {
            let u = window.motion.later_recorded_u(window.start, self.length, later_s);
            let values = u.into_iter().zip(sensors.iter().cycle());
            values.map(|(u, (gain, offset))| (u / gain - offset) as f32).collect()
        };
        self.windows.iter().map(of).collect()
    }

    /// Positions of the arms through all windows, `[arm][window, sample, joint]`, rad.
    fn positions(&self, arms: &[Arm]) -> Vec<Vec<f32>> {
        let robots: Vec<Robot> = arms.iter().map(Arm::robot).collect();
        let torques: Vec<Vec<Vec<f32>>> = arms.iter().map(|arm| self.torques(arm)).collect();
        let rollouts: Vec<Rollout<'_>> = robots
            .iter()
            .zip(&torques)
            .flat_map(|(robot, torques)| {
                self.windows.iter().zip(torques).map(move |(window, u)| Rollout {
                    robot,
                    q0: Joints::from(window.motion.q[window.start].as_slice()),
                    qd0: Joints::from(window.motion.qd[window.start].as_slice()),
                    u,
                    anchors: &[],
                })
            })
            .collect();
        let all = self.replay.run(&rollouts);
        all.chunks_exact(self.count() * self.length * self.joints).map(<[f32]>::to_vec).collect()
    }

    fn measured(&self, window: usize, sample: usize, joint: usize) -> f64 {
        let Window { motion, start } = self.windows[window];
        motion.q[start + sample][joint]
    }

    /// Errors over each of [`HORIZONS_S`] of a prediction, which gives the position of a window, a
    /// sample and a joint: the root mean square over the horizon, averaged over joints and windows,
    /// rad.
    fn errors_of(&self, predicted: impl Fn(usize, usize, usize) -> f64) -> [f64; 3] {
        HORIZONS_S.map(|horizon| {
            let samples = self.samples_in(horizon);
            let mut sum = 0.0;
            for window in 0..self.count() {
                for joint in 0..self.joints {
                    let squares = (1..=samples).map(|sample| {
                        let truth = self.measured(window, sample, joint);
                        (predicted(window, sample, joint) - truth).powi(2)
                    });
                    sum += (squares.sum::<f64>() / samples as f64).sqrt();
                }
            }
            sum / (self.count() * self.joints) as f64
        })
    }

    /// Errors of the arm's simulations, rad. See [`crate::HorizonErrors`].
    pub(crate) fn errors(&self, arm: &Arm) -> [f64; 3] {
        let positions = self.positions(std::slice::from_ref(arm)).remove(0);
        self.errors_of(|window, sample, joint| {
            f64::from(positions[(window * self.length + sample) * self.joints + joint])
        })
    }

    /// Errors of a linear law, rad.
    pub(crate) fn errors_of_law(&self, law: &Arx) -> [f64; 3] {
        let rollout = |window: &Window<'_>| law.rollout(window.motion, window.start, self.length);
        let positions: Vec<Vec<f64>> = self.windows.par_iter().map(rollout).collect();
        self.errors_of(|window, sample, joint| positions[window][sample * self.joints + joint])
    }

    /// Errors of a position that is held, rad.
    pub(crate) fn errors_of_holding(&self) -> [f64; 3] {
        self.errors_of(|window, _, joint| self.measured(window, 0, joint))
    }

    /// Errors of going on with the velocity, rad.
    pub(crate) fn errors_of_constant_velocity(&self) -> [f64; 3] {
        self.errors_of(|window, sample, joint| {
            let Window { motion, start } = self.windows[window];
            self.measured(window, 0, joint) + motion.qd[start][joint] * sample as f64 / self.rate_hz
        })
    }
}

/// The fit of an arm's simulations to windows.
pub(crate) struct RolloutFit<'a> {
    windows: &'a Windows<'a>,
    /// The samples of a window that count.
    samples: Vec<usize>,
    /// One over the variance, `[sample, joint]`.
    weights: Vec<f64>,
    /// Steps for differences, one per number; 0 for numbers that are known.
    steps: DVector<f64>,
}

impl<'a> RolloutFit<'a> {
    /// Weighs errors by those of `arm`, so that every joint and every time counts alike.
    /// `steps` are small changes of the numbers; 0 for numbers that are known.
    pub(crate) fn new(windows: &'a Windows<'a>, arm: &Arm, steps: DVector<f64>) -> Self {
        /// Times at which rollouts are compared, s.
        const TIMES_S: [f64; 8] = [0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.33];
        /// A simulation with an error below this is as good as the encoder, rad.
        const LEAST_ERROR_RAD: f64 = 1e-5;

        let samples: Vec<usize> =
            TIMES_S.iter().map(|time| windows.samples_in(*time).max(1)).collect();
        let mut fit = Self { windows, samples, weights: Vec::new(), steps };
        let residuals = fit.residuals(std::slice::from_ref(arm)).remove(0);
        let per_window = fit.samples.len() * windows.joints;
        let mut squares = vec![0.0; per_window];
        for window in residuals.chunks_exact(per_window) {
            for (square, residual) in squares.iter_mut().zip(window) {
                *square += residual * residual;
            }
        }
        // Errors at different times of a window are alike: together they count once.
        let alike = fit.samples.len() as f64;
        fit.weights = squares
            .iter()
            .map(|square| {
                let mean = (square / windows.count() as f64).max(LEAST_ERROR_RAD.powi(2));
                1.0 / (mean * alike)
            })
            .collect();
        fit
    }

    /// Predicted less measured positions, `[arm][window, sample, joint]`, rad.
    fn residuals(&self, arms: &[Arm]) -> Vec<Vec<f64>> {
        let Windows { joints, length, .. } = *self.windows;
        let of = |positions: Vec<f32>| -> Vec<f64> {
            (0..self.windows.count())
                .flat_map(|window| self.samples.iter().map(move |&sample| (window, sample)))
                .flat_map(|(window, sample)| (0..joints).map(move |joint| (window, sample, joint)))
                .map(|(window, sample, joint)| {
                    let predicted = positions[(window * length + sample) * joints + joint];
                    f64::from(predicted) - self.windows.measured(window, sample, joint)
                })
                .collect()
        };
        self.windows.positions(arms).into_iter().map(of).collect()
    }

    fn cost_of(&self, residuals: &[f64]) -> f64 {
        let squares = residuals.iter().zip(self.weights.iter().cycle());
        let cost =
            0.5 * squares.map(|(residual, weight)| weight * residual * residual).sum::<f64>();
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// ½ Σ of the weighted squares. Infinite if a simulation diverges.
    pub(crate) fn cost(&self, arm: &Arm) -> f64 {
        self.cost_of(&self.residuals(std::slice::from_ref(arm))[0])
    }

    pub(crate) fn normal_equations(&self, arm: &Arm) -> NormalEquations {
        let size = arm.numbers.len();
        let free: Vec<usize> = (0..size).filter(|number| self.steps[*number] > 0.0).collect();
        let mut arms = vec![arm.clone()];
        arms.extend(free.iter().map(|&number| {
            let mut numbers = arm.numbers.clone();
            numbers[number] += self.steps[number];
            arm.with_numbers(numbers)
        }));
        let residuals = self.residuals(&arms);
        let count = residuals[0].len();
        let weights: Vec<f64> =
            self.weights.iter().cycle().take(count).map(|weight| weight.sqrt()).collect();
        let mut derivatives = DMatrix::zeros(count, size);
        for (&number, moved) in free.iter().zip(&residuals[1..]) {
            for k in 0..count {
                let slope = (moved[k] - residuals[0][k]) / self.steps[number];
                derivatives[(k, number)] = if slope.is_finite() { weights[k] * slope } else { 0.0 };
            }
        }
        let weighted = DVector::from_fn(count, |row, _| weights[row] * residuals[0][row]);
        NormalEquations {
            cost: self.cost_of(&residuals[0]),
            gradient: derivatives.tr_mul(&weighted),
            curvature: derivatives.tr_mul(&derivatives),
        }
    }
}
