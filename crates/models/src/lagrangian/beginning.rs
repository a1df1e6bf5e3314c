//! A training begins: before its first step, a law that is not told its arm finds the chain in the
//! first batch, and takes the distribution of robots' numbers from there.

use burn::module::{Module, Param};
use burn::tensor::Tensor;
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};
use random::keyed;

use super::batch::{HostBatch, Points};
use super::chain::{self, Arm, FoundChain, Motions};
use super::law::{Limits, narrow};
use super::recorded::Recorded;
use super::regression::Prior;
use super::{Lagrangian, PACE, values, with};
use crate::architecture::ModelInput;

/// Samples of each context that show the chain, and that show its robots' numbers.
const POINTS: usize = 80;
/// Rounds of expectation-maximization.
const ROUNDS: usize = 12;
/// How far beyond the positions of the batch predictions may go, as a share of their range, and how
/// many times as fast as its motions.
const MORE_RANGE: f32 = 1.0;
const MORE_SPEED: f32 = 4.0;
/// A joint that is still in the batch counts as one of this range, rad, and speed, rad/s.
const LEAST_RANGE: f32 = 0.1;
const LEAST_SPEED: f32 = 0.5;
/// The initial spread of a number over robots, as a share of its mean; of a moment at least the
/// second.
const SPREAD_SHARE: f64 = 0.3;
const MOMENT_SPREAD: f64 = 0.1;
/// The least value of a number that is kept as a logarithm, N·m·s/rad or kg m².
const LEAST: f64 = 1e-4;
/// The least spread of a combination of moments.
const LEAST_MOMENT_SPREAD: f64 = 2e-3;
/// The root mean square of the least torque that a number makes, as a share of the residual torques.
const LEAST_TORQUE: f64 = 0.03;
/// The share of a rotor that all robots have in common, where rotors are fitted.
const COMMON_ROTOR: f64 = 0.05;

impl Lagrangian {
    /// The law with the chain of the robots in `input`, if it has to find one.
    pub(super) fn with_found_chain(mut self, input: &ModelInput, seed: u64) -> Self {
        let Some(unknown) = self.chain.take() else { return self };
        let mut batch = HostBatch::new(input);
        batch.smooth(input.measurement_noise);
        let [robots, ..] = input.u.dims();
        let recordings: Vec<Recorded<'_>> = (0..robots).map(|robot| batch.robot(robot)).collect();
        let motions = Motions::new(&recordings, POINTS, self.gravity);
        let arm = chain::find(&motions, &mut keyed([seed, 0, 0, 0]));
        let limits = limits(&recordings);
        self.chain = Some(unknown.with_chain(&arm.chain, &limits));
        self.with_numbers_of(&motions, &arm).with_distribution_of(&recordings)
    }

    /// The law whose robots have in the mean the numbers that fit all motions.
    fn with_numbers_of(mut self, motions: &Motions, arm: &Arm) -> Self {
        let common = motions.common_numbers(arm);
        let [dampings, frictions, rotors] =
            [&common.dampings, &common.frictions, &common.rotors].map(|values| positive(values));
        let mut mean = [common.moments, dampings, frictions].concat();
        if self.numbers.rotors {
            mean.extend(&rotors);
        }
        mean.resize(self.numbers.count(), 0.0);
        let least = |number: usize| {
            if self.numbers.weights().contains(&number) { MOMENT_SPREAD } else { LEAST }
        };
        let spreads = mean.iter().enumerate();
        let spread =
            spreads.map(|(number, mean)| (SPREAD_SHARE * mean.abs()).max(least(number))).collect();
        if let Some(shapes) = arm.friction_shapes() {
            let slopes = shapes.iter().map(|shape| shape.slope);
            self.friction_slope = with_logarithms(self.friction_slope, slopes);
            let shifts: Vec<f64> = shapes.iter().map(|shape| shape.shift).collect();
            self.friction_shift = with(self.friction_shift, narrow(&shifts));
        }
        let share = if self.numbers.rotors { COMMON_ROTOR } else { 1.0 };
        self.armature =
            with_logarithms(self.armature, rotors.iter().map(|rotor| (share * rotor).max(LEAST)));
        self.with_prior(&Prior { mean, spread })
    }

    /// The law with the distribution of numbers and residual torques of these robots, by
    /// expectation-maximization.
    fn with_distribution_of(mut self, recordings: &[Recorded<'_>]) -> Self {
        let joints = self.numbers.joints;
        let samples = recordings.iter().map(Recorded::samples).min().unwrap_or_default();
        let stride = (samples.saturating_sub(2) / POINTS).max(1);
        let chosen: Vec<usize> =
            (1..samples.saturating_sub(1)).step_by(stride).take(POINTS).collect();
        let mut points = Points::new([recordings.len(), joints, chosen.len()], self.first);
        for recorded in recordings {
            chosen.iter().for_each(|&sample| points.push(recorded, sample));
        }
        let device = self.valid().share.val().device();
        for _ in 0..ROUNDS {
            let [factors, torques] = self.valid().equations(&points, &device).map(values);
            let prior = self.prior();
            let laws = self.joint_laws();
            let fitted = points.fit(&factors, &torques, &laws, &prior, self.numbers);
            let noise = fitted.residual_torques(&factors, &torques, joints);
            self.noise =
                with_logarithms(self.noise, noise.into_iter().map(|noise| noise.max(LEAST)));
            let basis = self.chain.as_ref().map(FoundChain::basis);
            let covariance = basis.map(|basis| fitted.covariance_over_robots(&basis));
            self = self.with_prior(&fitted.over_robots());
            self = match covariance {
                Some(covariance) => self.in_basis_of(covariance),
                None => self,
            };
        }
        let [factors, _] = self.valid().equations(&points, &device).map(values);
        self.without_unseen_numbers(&factors)
    }

    /// The same law with numbers that are independent over robots and have a spread of 1 each, in the
    /// place of moments with this covariance.
    fn in_basis_of(mut self, covariance: DMatrix<f64>) -> Self {
        let Some(decomposed) = decomposed(covariance) else { return self };
        let Some(found) = self.chain.take() else { return self };
        let SymmetricEigen { eigenvectors, eigenvalues } = decomposed;
        let Prior { mut mean, mut spread } = self.prior();
        let count = eigenvalues.len();
        let moments = found.basis() * DVector::from_column_slice(&mean[..count]);
        let roots = eigenvalues.map(|square| square.max(LEAST_MOMENT_SPREAD.powi(2)).sqrt());
        let numbers = eigenvectors.tr_mul(&moments).component_div(&roots);
        mean[..count].copy_from_slice(numbers.as_slice());
        spread[..count].fill(1.0);
        let basis = &eigenvectors * DMatrix::from_diagonal(&roots);
        self.chain = Some(found.with_basis(narrow(basis.transpose().as_slice())));
        self.with_prior(&Prior { mean, spread })
    }

    /// The same law without the combinations of numbers that make no torque in these equations: the
    /// base is fixed, and the first links only turn. What a training does not see drifts.
    fn without_unseen_numbers(mut self, factors: &[f32]) -> Self {
        let (count, width) = (self.numbers.weights().len(), self.numbers.count() + 1);
        let laws = self.joint_laws();
        let rows = factors.len() / width;
        let in_noise = DMatrix::from_fn(rows, count, |row, number| {
            f64::from(factors[row * width + number] / laws[row % laws.len()].noise)
        });
        let squares = in_noise.transpose() * in_noise / rows as f64;
        let Some(decomposed) = decomposed(squares) else { return self };
        let Some(found) = self.chain.take() else { return self };
        let SymmetricEigen { mut eigenvectors, eigenvalues } = decomposed;
        let Prior { mut mean, spread } = self.prior();
        let means = eigenvectors.tr_mul(&DVector::from_column_slice(&mean[..count]));
        for (number, (square, of_robots)) in eigenvalues.iter().zip(&means).enumerate() {
            let is_seen = square * (1.0 + of_robots.powi(2)) > LEAST_TORQUE.powi(2);
            mean[number] = if is_seen { *of_robots } else { 0.0 };
            if !is_seen {
                eigenvectors.column_mut(number).fill(0.0);
            }
        }
        let basis = found.basis() * eigenvectors;
        self.chain = Some(found.with_basis(narrow(basis.transpose().as_slice())));
        self.with_prior(&Prior { mean, spread })
    }

    /// The law whose robots have these means and spreads.
    fn with_prior(mut self, prior: &Prior) -> Self {
        let Prior { mean, spread } = prior;
        let numbers = self.numbers;
        self.masses = self.masses.map(|masses| with(masses, narrow(&mean[numbers.weights()])));
        self.damping = with_logarithms(self.damping, positive(&mean[numbers.dampings()]));
        let units = self.friction_units.iter().copied().map(f64::from);
        let frictions = mean[numbers.frictions()].iter().zip(units);
        let frictions: Vec<f64> =
            frictions.map(|(friction, unit)| friction.max(0.0) / unit / f64::from(PACE)).collect();
        self.friction = with(self.friction, narrow(&frictions));
        self.rotor =
            self.rotor.map(|rotor| with_logarithms(rotor, positive(&mean[numbers.rotors()])));
        self.spread = with_logarithms(self.spread, positive(spread));
        self
    }
}

/// The eigenvalues and eigenvectors of a symmetric matrix. `None` if an entry is not finite.
fn decomposed(matrix: DMatrix<f64>) -> Option<SymmetricEigen<f64, Dyn>> {
    matrix.iter().all(|entry| entry.is_finite()).then(|| SymmetricEigen::new(matrix))
}

/// Where predictions stay: about as far and as fast as these motions.
fn limits(recordings: &[Recorded<'_>]) -> Vec<Limits> {
    let joints = recordings.first().map_or(0, |recorded| recorded.joints);
    let of_joint = |joint: usize| {
        let (mut low, mut high, mut speed) = (f32::MAX, f32::MIN, 0.0_f32);
        for recorded in recordings {
            let positions = recorded.y[joint..].iter().step_by(joints);
            for (&position, &next) in positions.clone().zip(positions.skip(1)) {
                low = low.min(position).min(next);
                high = high.max(position).max(next);
                speed = speed.max((next - position).abs() * recorded.rate_hz);
            }
        }
        let more = MORE_RANGE * (high - low).max(LEAST_RANGE);
        Limits { position: [low - more, high + more], speed: MORE_SPEED * speed.max(LEAST_SPEED) }
    };
    (0..joints).map(of_joint).collect()
}

/// The values, at least [`LEAST`].
fn positive(values: &[f64]) -> Vec<f64> {
    values.iter().map(|value| value.max(LEAST)).collect()
}

/// A parameter that keeps the logarithms of these values, over [`PACE`].
#[expect(clippy::cast_possible_truncation, reason = "parameters are f32")]
fn with_logarithms(
    param: Param<Tensor<1>>,
    values: impl IntoIterator<Item = f64>,
) -> Param<Tensor<1>> {
    with(param, values.into_iter().map(|value| value.ln() as f32 / PACE).collect())
}
