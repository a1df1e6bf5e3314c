//! The fit of a robot's numbers to its torques: Bayesian linear regression, in closed form.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Rounds in which numbers below their bound are held at it and the others are fitted again.
const ROUNDS: usize = 8;

/// The numbers that are fitted to one robot, in order: the weight of each particle (or as many
/// moments of the links, where the arm is told), the strength of each force, and of each joint its
/// damping in N·m·s/rad, its friction in N·m, its rotor inertia in kg m², and the offset of its
/// torque in N·m.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Numbers {
    pub particles: usize,
    pub forces: usize,
    pub joints: usize,
    /// Whether moments take the place of weights.
    pub moments: bool,
    /// Whether rotor inertias are fitted.
    pub rotors: bool,
    /// Whether offsets are fitted.
    pub offsets: bool,
}

/// The factors of a joint's own numbers in its equation, in the order of [`Numbers`].
pub(super) type OwnFactors = [f32; 4];

impl Numbers {
    pub fn count(self) -> usize {
        self.offsets().end
    }

    /// Own numbers of a joint.
    pub fn own(self) -> usize {
        2 + usize::from(self.rotors) + usize::from(self.offsets)
    }

    /// The factors of a joint's own numbers that are fitted, first.
    pub fn own_factors(self, velocity: f32, friction: f32, acceleration: f32) -> OwnFactors {
        if self.rotors {
            [velocity, friction, acceleration, 1.0]
        } else {
            [velocity, friction, 1.0, 0.0]
        }
    }

    pub fn weights(self) -> Range<usize> {
        0..self.particles
    }

    pub fn strengths(self) -> Range<usize> {
        self.particles..self.particles + self.forces
    }

    /// Weights and strengths, which occur in the equations of every joint.
    pub fn shared(self) -> Range<usize> {
        0..self.particles + self.forces
    }

    pub fn dampings(self) -> Range<usize> {
        let first = self.shared().end;
        first..first + self.joints
    }

    pub fn frictions(self) -> Range<usize> {
        let first = self.dampings().end;
        first..first + self.joints
    }

    /// Empty if none are fitted.
    pub fn rotors(self) -> Range<usize> {
        let first = self.frictions().end;
        first..first + if self.rotors { self.joints } else { 0 }
    }

    /// Empty if none are fitted.
    pub fn offsets(self) -> Range<usize> {
        let first = self.rotors().end;
        first..first + if self.offsets { self.joints } else { 0 }
    }

    /// Whether a number must be at least 0. Forces, moments and offsets have both signs.
    pub fn is_bounded(self, number: usize, bounds: Bounds) -> bool {
        let is_moment = self.moments && self.weights().contains(&number);
        let is_signed =
            is_moment || self.strengths().contains(&number) || self.offsets().contains(&number);
        match bounds {
            Bounds::Dissipation => !is_signed && !self.weights().contains(&number),
            Bounds::DissipationAndMasses => !is_signed,
        }
    }

    /// Raises numbers below their bound to it.
    pub fn keep_bounds<T: PartialOrd + Default>(self, values: &mut [T], bounds: Bounds) {
        for (number, value) in values.iter_mut().enumerate() {
            if *value < T::default() && self.is_bounded(number, bounds) {
                *value = T::default();
            }
        }
    }
}

/// The numbers of a robot that must be at least 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bounds {
    /// Dampings, frictions and rotors. A particle is not a body of its own, so its mass may be
    /// negative and correct that of the others.
    Dissipation,
    /// Masses, too. Moments are nearer to those that robots have in the mean.
    DissipationAndMasses,
}

/// The prior distribution of a robot's numbers: independent and normal.
#[derive(Clone, Debug)]
pub(super) struct Prior {
    pub mean: Vec<f64>,
    /// Standard deviations over robots.
    pub spread: Vec<f64>,
}

/// Sums over samples for the regression of the torque on the factor of each number.
#[derive(Clone, Debug)]
pub(super) struct Regression {
    numbers: Numbers,
    joints: Vec<JointSums>,
    /// Buffer for the factors of an equation.
    factors: Vec<f64>,
}

/// Sums over the samples of a joint. Its equations have the shared numbers, its own damping and its
/// own friction.
#[derive(Clone, Debug)]
struct JointSums {
    /// Σ x xᵀ, `[row, column]`, the lower triangle.
    squares: Vec<f64>,
    /// Σ x u, N·m.
    products: Vec<f64>,
    /// Σ u², (N·m)².
    torque: f64,
    samples: f64,
}

/// The equation of one joint at one sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equation<'a> {
    pub joint: usize,
    /// Torques of each particle of weight 1 and of each force of strength 1, N·m.
    pub shared: &'a [f32],
    /// The factors of the joint's own numbers.
    pub own: OwnFactors,
    /// The torque on the right-hand side, N·m.
    pub torque: f32,
}

impl Equation<'_> {
    /// The residual torque with these numbers, N·m.
    #[expect(clippy::cast_possible_truncation, reason = "torques are in f32")]
    pub fn residual_torque(&self, of: Numbers, numbers: &[f64]) -> f32 {
        let shared = self.shared.iter().zip(numbers);
        let expected: f64 = shared.map(|(&torque, number)| f64::from(torque) * number).sum();
        let own = self.own.iter().take(of.own()).enumerate().map(|(kind, &factor)| {
            let number = of.shared().end + kind * of.joints + self.joint;
            numbers[number] * f64::from(factor)
        });
        own.fold(f64::from(self.torque) - expected, |left, torque| left - torque) as f32
    }
}

/// The equations of a context, for each joint at every sample.
#[derive(Debug)]
pub(super) struct Equations {
    numbers: Numbers,
    shared: Vec<f32>,
    /// The factors of a joint's own numbers, and the torque.
    own: Vec<(OwnFactors, f32)>,
}

impl Equations {
    pub fn new(numbers: Numbers) -> Self {
        Self { numbers, shared: Vec::new(), own: Vec::new() }
    }

    /// Appends an equation. Joints take turns.
    pub fn push(&mut self, equation: &Equation<'_>) {
        self.shared.extend_from_slice(equation.shared);
        self.own.push((equation.own, equation.torque));
    }

    pub fn samples(&self) -> usize {
        self.own.len() / self.numbers.joints
    }

    /// The equations of some samples.
    pub fn of(&self, samples: Range<usize>) -> impl Iterator<Item = Equation<'_>> {
        let (joints, width) = (self.numbers.joints, self.numbers.shared().len());
        (samples.start * joints..samples.end * joints).map(move |index| {
            let (own, torque) = self.own[index];
            let shared = &self.shared[index * width..][..width];
            Equation { joint: index % joints, shared, own, torque }
        })
    }
}

impl Regression {
    pub fn new(numbers: Numbers) -> Self {
        let width = numbers.shared().len() + numbers.own();
        let none = JointSums {
            squares: vec![0.0; width * width],
            products: vec![0.0; width],
            torque: 0.0,
            samples: 0.0,
        };
        Self { numbers, joints: vec![none; numbers.joints], factors: vec![0.0; width] }
    }

    pub fn add(&mut self, equation: &Equation<'_>) {
        let &Equation { joint, shared, own, torque } = equation;
        let width = self.factors.len();
        let each = shared.iter().chain(&own);
        for (factor, &value) in self.factors.iter_mut().zip(each) {
            *factor = f64::from(value);
        }
        let sums = &mut self.joints[joint];
        let torque = f64::from(torque);
        for (row, &factor) in self.factors.iter().enumerate() {
            for (sum, other) in sums.squares[row * width..][..=row].iter_mut().zip(&self.factors) {
                *sum += factor * other;
            }
            sums.products[row] += factor * torque;
        }
        sums.torque += torque * torque;
        sums.samples += 1.0;
    }

    /// Adds the sums of another regression.
    pub fn add_all(&mut self, other: &Self) {
        for (sums, more) in self.joints.iter_mut().zip(&other.joints) {
            let sums_of = sums.squares.iter_mut().chain(&mut sums.products);
            for (sum, more) in sums_of.zip(more.squares.iter().chain(&more.products)) {
                *sum += more;
            }
            sums.torque += more.torque;
            sums.samples += more.samples;
        }
    }

    /// The number whose factor is at `place` in the equations of a joint.
    fn number(&self, joint: usize, place: usize) -> usize {
        let shared = self.numbers.shared().end;
        match place.checked_sub(shared) {
            None => place,
            Some(kind) => shared + kind * self.numbers.joints + joint,
        }
    }

    /// The distribution of the numbers given these sums. `noise` has the standard deviation of each
    /// joint's torques, N·m.
    pub fn posterior(&self, prior: &Prior, noise: &[f64]) -> Option<Posterior> {
        self.normal_equations(noise).solve(prior, &vec![false; self.numbers.count()])
    }

    /// [`Regression::posterior`] within bounds.
    pub fn bounded_posterior(&self, prior: &Prior, noise: &[f64], bounds: Bounds) -> Posterior {
        self.normal_equations(noise).bounded_posterior(self.numbers, prior, bounds)
    }

    /// The root mean square of a joint's residual torque with `numbers`, N·m.
    pub fn residual_torque(&self, joint: usize, numbers: &[f64]) -> f64 {
        let sums = &self.joints[joint];
        let width = self.factors.len();
        let value = |place: usize| numbers[self.number(joint, place)];
        let mut squares = sums.torque;
        for row in 0..width {
            let mut along = -2.0 * sums.products[row];
            for column in 0..row {
                along += 2.0 * sums.squares[row * width + column] * value(column);
            }
            along += sums.squares[row * width + row] * value(row);
            squares += along * value(row);
        }
        (squares.max(0.0) / sums.samples.max(1.0)).sqrt()
    }

    /// The sums over all joints, whose torques have these standard deviations, N·m.
    fn normal_equations(&self, noise: &[f64]) -> NormalEquations {
        let count = self.numbers.count();
        let mut squares = DMatrix::zeros(count, count);
        let mut products = vec![0.0; count];
        let width = self.factors.len();
        for (joint, (sums, noise)) in self.joints.iter().zip(noise).enumerate() {
            let precision = noise.powi(-2);
            for row in 0..width {
                let number = self.number(joint, row);
                products[number] += precision * sums.products[row];
                for column in 0..=row {
                    squares[(number, self.number(joint, column))] +=
                        precision * sums.squares[row * width + column];
                }
            }
        }
        NormalEquations { squares, products }
    }
}

/// Sums over equations with noise of deviation 1.
#[derive(Clone, Debug)]
struct NormalEquations {
    /// Σ x xᵀ, the lower triangle.
    squares: DMatrix<f64>,
    /// Σ x u.
    products: Vec<f64>,
}

impl NormalEquations {
    /// The distribution of the numbers given these sums, within bounds. Numbers below their bound
    /// are held at it and the others are fitted again.
    fn bounded_posterior(&self, numbers: Numbers, prior: &Prior, bounds: Bounds) -> Posterior {
        let mut held = vec![false; numbers.count()];
        let mut found = Posterior::from_prior(prior);
        for _ in 0..ROUNDS {
            let Some(posterior) = self.solve(prior, &held) else { break };
            found = posterior;
            let mut any = false;
            for (number, value) in found.mean.iter().enumerate() {
                if *value < 0.0 && numbers.is_bounded(number, bounds) {
                    (held[number], any) = (true, true);
                }
            }
            if !any {
                break;
            }
        }
        numbers.keep_bounds(&mut found.mean, bounds);
        found.bounds = bounds;
        found
    }

    /// Solves in units of the spreads, in which the prior variance is 1. Numbers that are `held`
    /// are 0.
    fn solve(&self, prior: &Prior, held: &[bool]) -> Option<Posterior> {
        let Self { squares, products } = self;
        let count = products.len();
        let spread = |number: usize| if held[number] { 0.0 } else { prior.spread[number] };
        let precision = DMatrix::from_fn(count, count, |row, column| {
            let (row, column) = (row.max(column), row.min(column));
            let entry = spread(row) * spread(column) * squares[(row, column)];
            if row == column { entry + 1.0 } else { entry }
        });
        let right = DVector::from_fn(count, |number, _| match held[number] {
            true => 0.0,
            false => {
                let expected = prior.mean[number] / prior.spread[number];
                prior.spread[number] * products[number] + expected
            }
        });
        let factor = precision.cholesky()?;
        let scaled = factor.solve(&right);
        let mean: Vec<f64> = (0..count).map(|number| spread(number) * scaled[number]).collect();
        let finite = mean.iter().all(|value| value.is_finite());
        let spread = (0..count).map(spread).collect();
        finite.then_some(Posterior { mean, bounds: Bounds::Dissipation, spread, factor })
    }
}

/// The posterior distribution of a robot's numbers, which is normal.
#[derive(Clone, Debug)]
pub(super) struct Posterior {
    pub mean: Vec<f64>,
    /// The numbers that must be at least 0.
    pub bounds: Bounds,
    /// Spreads over robots; 0 for a number that is held.
    spread: Vec<f64>,
    /// The Cholesky factor of the precision, in units of the spreads.
    factor: Cholesky<f64, Dyn>,
}

impl Posterior {
    /// Moves the weights half-way to those of the prior.
    pub fn halve(&mut self, prior: &Prior, numbers: Numbers) {
        let each = self.mean[numbers.weights()].iter_mut().zip(&prior.mean);
        each.for_each(|(number, mean)| *number = f64::midpoint(*number, *mean));
    }

    /// The prior, for a robot without data.
    fn from_prior(prior: &Prior) -> Self {
        let count = prior.mean.len();
        let factor = Cholesky::pack_dirty(DMatrix::identity(count, count));
        let (mean, spread) = (prior.mean.clone(), prior.spread.clone());
        Self { mean, bounds: Bounds::Dissipation, spread, factor }
    }

    /// A draw of the difference to the mean, from one standard normal number for each number.
    pub fn deviation(&self, normal: &[f32]) -> Vec<f64> {
        let normal = DVector::from_iterator(normal.len(), normal.iter().copied().map(f64::from));
        let scaled = self.factor.l_dirty().tr_solve_lower_triangular(&normal).unwrap_or(normal);
        scaled.iter().zip(&self.spread).map(|(value, spread)| value * spread).collect()
    }

    /// A root of the covariance, `[number, column]`: the root times its transpose is the
    /// covariance.
    pub fn root(&self) -> DMatrix<f64> {
        let count = self.mean.len();
        let one = DMatrix::identity(count, count);
        let mut root = self.factor.l_dirty().tr_solve_lower_triangular(&one).unwrap_or(one);
        for (mut row, &spread) in root.row_iter_mut().zip(&self.spread) {
            row *= spread;
        }
        root
    }

    /// The information gain over the prior: half the logarithm of the ratio of both determinants.
    pub fn information_gain(&self) -> f64 {
        self.factor.l_dirty().diagonal().iter().map(|entry| entry.ln()).sum()
    }
}
