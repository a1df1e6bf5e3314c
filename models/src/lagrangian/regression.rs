//! The fit of a robot's numbers to its torques: Bayesian linear regression, in closed form.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::numbers::Numbers;

/// The times that numbers below their bound are held at it and the others fitted again.
const ROUNDS: usize = 8;

/// Knowledge of the numbers before their robot is seen: independent and normal.
#[derive(Clone, Debug)]
pub(super) struct Prior {
    pub mean: Vec<f64>,
    /// Standard deviations over robots.
    pub spread: Vec<f64>,
}

/// Sums over samples and joints for the regression of torque on what each number is multiplied with.
#[derive(Clone, Debug)]
pub(super) struct Regression {
    numbers: Numbers,
    /// Σ x xᵀ / σ², `[row, column]`, the lower triangle.
    squares: Vec<f64>,
    /// Σ x u / σ².
    products: Vec<f64>,
}

/// One joint at one sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equation<'a> {
    pub joint: usize,
    /// Torques of each particle of weight 1 and of each force of strength 1, N·m.
    pub shared: &'a [f32],
    /// rad/s.
    pub velocity: f32,
    /// Friction of strength 1, N·m.
    pub friction: f32,
    /// The torque that all of these are to add up to, N·m.
    pub torque: f32,
    /// 1 / σ² of the torque that is left over.
    pub precision: f64,
}

impl Regression {
    pub fn new(numbers: Numbers) -> Self {
        let count = numbers.count();
        Self { numbers, squares: vec![0.0; count * count], products: vec![0.0; count] }
    }

    pub fn add(&mut self, equation: &Equation<'_>) {
        let &Equation { joint, shared, velocity, friction, torque, precision } = equation;
        let count = self.numbers.count();
        let own = [
            (self.numbers.dampings().start + joint, f64::from(velocity)),
            (self.numbers.frictions().start + joint, f64::from(friction)),
        ];
        let torque = precision * f64::from(torque);
        for (row, &x) in shared.iter().enumerate() {
            let x = f64::from(x);
            let weighted = precision * x;
            let sums = &mut self.squares[row * count..][..=row];
            for (sum, &other) in sums.iter_mut().zip(shared) {
                *sum += weighted * f64::from(other);
            }
            self.products[row] += x * torque;
        }
        for (place, (row, x)) in own.into_iter().enumerate() {
            let weighted = precision * x;
            let sums = &mut self.squares[row * count..];
            for (sum, &other) in sums.iter_mut().zip(shared) {
                *sum += weighted * f64::from(other);
            }
            for &(column, other) in &own[..=place] {
                sums[column] += weighted * other;
            }
            self.products[row] += x * torque;
        }
    }

    /// The distribution of the numbers given these sums, each of which counts as `weight` of itself.
    pub fn posterior(&self, prior: &Prior, weight: f64) -> Option<Posterior> {
        self.solve(prior, weight, &vec![false; self.numbers.count()])
    }

    /// The most likely numbers of a robot that could be: with [`Numbers::is_bounded`] kept.
    #[expect(clippy::cast_possible_truncation, reason = "the law is computed in f32")]
    pub fn most_likely(&self, prior: &Prior, weight: f64) -> Vec<f32> {
        let mut held = vec![false; self.numbers.count()];
        let mut found: Vec<f64> = prior.mean.clone();
        for _ in 0..ROUNDS {
            let Some(posterior) = self.solve(prior, weight, &held) else { break };
            found = posterior.mean;
            let mut any = false;
            for (number, value) in found.iter().enumerate() {
                if *value < 0.0 && self.numbers.is_bounded(number) {
                    (held[number], any) = (true, true);
                }
            }
            if !any {
                break;
            }
        }
        let bounded = found.iter().enumerate().map(|(number, &value)| {
            if self.numbers.is_bounded(number) { value.max(0.0) } else { value }
        });
        bounded.map(|value| value as f32).collect()
    }

    /// In units of the spreads, where what nothing is known of has a variance of 1. Numbers that are `held`
    /// are 0.
    fn solve(&self, prior: &Prior, weight: f64, held: &[bool]) -> Option<Posterior> {
        let count = self.numbers.count();
        let spread = |number: usize| if held[number] { 0.0 } else { prior.spread[number] };
        let precision = DMatrix::from_fn(count, count, |row, column| {
            let (row, column) = (row.max(column), row.min(column));
            let told = weight * spread(row) * spread(column) * self.squares[row * count + column];
            if row == column { told + 1.0 } else { told }
        });
        let right = DVector::from_fn(count, |number, _| match held[number] {
            true => 0.0,
            false => {
                let known = prior.mean[number] / prior.spread[number];
                weight * prior.spread[number] * self.products[number] + known
            }
        });
        let factor = precision.cholesky()?;
        let scaled = factor.solve(&right);
        let mean: Vec<f64> = (0..count).map(|number| spread(number) * scaled[number]).collect();
        let finite = mean.iter().all(|value| value.is_finite());
        finite.then(|| Posterior { mean, spread: prior.spread.clone(), factor })
    }
}

/// The distribution of a robot's numbers once it was seen: normal.
#[derive(Clone, Debug)]
pub(super) struct Posterior {
    pub mean: Vec<f64>,
    spread: Vec<f64>,
    /// The factor of the precision, in units of the spreads.
    factor: Cholesky<f64, Dyn>,
}

impl Posterior {
    /// A root of the covariance, `[number, column]`: times its transpose it is the covariance.
    pub fn root(&self) -> DMatrix<f64> {
        let count = self.mean.len();
        let one = DMatrix::identity(count, count);
        let mut root = self.factor.l_dirty().tr_solve_lower_triangular(&one).unwrap_or(one);
        for (mut row, &spread) in root.row_iter_mut().zip(&self.spread) {
            row *= spread;
        }
        root
    }

    /// How much narrower than the prior it is: half the logarithm of the ratio of both determinants.
    pub fn told(&self) -> f64 {
        self.factor.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum()
    }
}
