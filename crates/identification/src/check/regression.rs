//! The regression of a channel of torques on the torques of an arm.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SMatrix, SVector};

use wire::Measurement;

use super::rows::{FRICTION, FRICTION_SPEEDS_RAD_S, GRAVITY, OFFSET, OWN, REST};

/// Rounds in which the noise and the scale of the torques settle.
const ROUNDS: usize = 4;

/// No channel is explained better than this share of its variance: differences of positions are only
/// so near to velocities.
pub const LEAST_SHARE: f64 = 1e-4;

/// The columns of a regression, and their products.
pub struct Regression {
    pub design: DMatrix<f64>,
    gram: DMatrix<f64>,
    /// Root mean squares of the first columns; those of the arm's torques are about their mean.
    sizes: [f64; OWN],
    /// The same of both of the arm's torques together.
    size_of_arm: f64,
}

/// The result of a regression.
pub struct Fit {
    /// Of the columns.
    pub coefficients: DVector<f64>,
    /// The covariance of the first ones, which are no deviations of links.
    covariance: SMatrix<f64, OWN, OWN>,
    /// Σ of the squares that are left.
    pub left: f64,
    /// ½ Σ of the squared deviations of the links.
    pub distance: f64,
    deviations: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    weight: f64,
}

/// The products of a channel with the columns.
pub struct Moments {
    of_columns: DVector<f64>,
    square: f64,
    /// Variance × samples.
    spread: f64,
    count: f64,
}

impl Moments {
    pub fn variance(&self) -> f64 {
        self.spread / self.count
    }

    fn rms(&self) -> f64 {
        (self.square / self.count).sqrt()
    }
}

impl Regression {
    /// `gravity` is the share of the arm's weight that is expected in the torques.
    pub fn new(design: DMatrix<f64>, gravity: f64) -> Self {
        let gram = design.tr_mul(&design);
        let rms = |column: usize| (gram[(column, column)] / design.nrows() as f64).sqrt();
        let mut sizes = std::array::from_fn(rms);
        let deviation = |column: DVector<f64>| column.variance().sqrt();
        sizes[GRAVITY] = deviation(design.column(GRAVITY).into_owned());
        sizes[REST] = deviation(design.column(REST).into_owned());
        let size_of_arm = deviation(design.column(GRAVITY) * gravity + design.column(REST));
        Self { design, gram, sizes, size_of_arm }
    }

    pub fn moments(&self, torques: &DVector<f64>) -> Moments {
        Moments {
            of_columns: self.design.tr_mul(torques),
            square: torques.norm_squared(),
            spread: torques.variance() * torques.len() as f64,
            count: torques.len() as f64,
        }
    }

    /// Standard deviations of the coefficients before anything is known. The links differ from
    /// the description in proportion to the scale of the torques.
    fn deviations(&self, moments: &Moments, scale: f64) -> DVector<f64> {
        /// Friction and rotors are some times as large as the torques at most. Their columns have
        /// at least these sizes: friction of 1 N·m, rad/s, rad/s², 1.
        const OF_OWN: f64 = 3.0;
        const OF_ARM: f64 = 30.0;
        const LEAST: [f64; OWN] = [1e-6, 1e-6, 0.02, 0.02, 1e-3, 1e-2, 1.0];

        let size = moments.rms();
        DVector::from_fn(self.gram.nrows(), |column, _| match column {
            GRAVITY | REST => OF_ARM * size / self.sizes[column].max(LEAST[column]),
            OFFSET => OF_ARM * size,
            column if column < OWN => OF_OWN * size / self.sizes[column].max(LEAST[column]),
            _ => scale,
        })
    }

    /// `alike` consecutive rows count as one. `None` if rounding makes the equations singular.
    pub fn fit(&self, moments: &Moments, alike: f64) -> Option<Fit> {
        let most = 2.0 * moments.variance().sqrt() / self.size_of_arm.max(1e-9);
        let (mut scale, mut left) = (0.5 * most, 0.1 * moments.spread);
        let mut last = None;
        for _ in 0..ROUNDS {
            let noise = left.max(LEAST_SHARE * moments.spread) / moments.count;
            let fit =
                self.solve(moments, self.deviations(moments, scale), 1.0 / (noise * alike))?;
            left = fit.left;
            scale = fit.size_of_scale().clamp(0.02 * most, most);
            last = Some(fit);
        }
        last
    }

    /// The friction at the joint's usual speed, N·m. It brakes if the torque has the sign of the
    /// position.
    pub fn friction(&self, fit: &Fit) -> Measurement {
        let [_, _, viscous] = FRICTION;
        let speed = self.sizes[viscous];
        let [slow, fast] = FRICTION_SPEEDS_RAD_S.map(|bend| (speed / bend).tanh());
        let mut at_speed = SVector::<f64, OWN>::zeros();
        for (column, value) in FRICTION.into_iter().zip([slow, fast, speed]) {
            at_speed[column] = value;
        }
        let value = at_speed.dot(&fit.coefficients.fixed_rows::<OWN>(0));
        Measurement { value, deviation: at_speed.dot(&(fit.covariance * at_speed)).sqrt() }
    }

    /// Solves (P G P w + 1) x = P m w for the coefficients P x.
    fn solve(&self, moments: &Moments, deviations: DVector<f64>, weight: f64) -> Option<Fit> {
        let mut matrix = DMatrix::from_fn(self.gram.nrows(), self.gram.ncols(), |row, column| {
            self.gram[(row, column)] * deviations[row] * deviations[column] * weight
        });
        for k in 0..matrix.nrows() {
            matrix[(k, k)] += 1.0;
        }
        let factor = matrix.cholesky()?;
        let unit = factor.solve(&(moments.of_columns.component_mul(&deviations) * weight));
        let coefficients = unit.component_mul(&deviations);
        let mut covariance = SMatrix::zeros();
        for column in 0..OWN {
            let mut of_column = DVector::zeros(deviations.len());
            of_column[column] = deviations[column];
            factor.solve_mut(&mut of_column);
            for row in 0..OWN {
                covariance[(row, column)] = of_column[row] * deviations[row];
            }
        }
        let left = moments.square - 2.0 * coefficients.dot(&moments.of_columns)
            + coefficients.dot(&(&self.gram * &coefficients));
        let distance = 0.5 * unit.rows_range(OWN..).norm_squared();
        let left = left.max(0.0);
        Some(Fit { coefficients, covariance, left, distance, deviations, factor, weight })
    }
}

impl Fit {
    /// ½ Σ of the weighted squares and of the prior's at the best coefficients for these torques,
    /// with noise and prior as in this fit.
    pub fn cost(&self, moments: &Moments) -> f64 {
        let known = moments.of_columns.component_mul(&self.deviations) * self.weight;
        0.5 * (self.weight * moments.square - known.dot(&self.factor.solve(&known)))
    }

    pub fn measurement(&self, column: usize) -> Measurement {
        let deviation = self.covariance[(column, column)].sqrt();
        Measurement { value: self.coefficients[column], deviation }
    }

    /// The scale of the torques if their weight and the rest have the same one.
    pub fn common_scale(&self) -> Measurement {
        let (difference, variance) = self.difference();
        let [weight, rest] = [GRAVITY, REST].map(|column| self.measurement(column));
        let shared = rest.deviation.powi(2) - self.covariance[(GRAVITY, REST)];
        let value = rest.value + shared / variance * difference;
        let both = weight.deviation.powi(2) * rest.deviation.powi(2)
            - self.covariance[(GRAVITY, REST)].powi(2);
        Measurement { value, deviation: (both / variance).max(0.0).sqrt() }
    }

    /// The scale of the torques if they come without the weight.
    pub fn scale_without_weight(&self) -> Measurement {
        let [weight, rest] = [GRAVITY, REST].map(|column| self.measurement(column));
        let slope = self.covariance[(GRAVITY, REST)] / weight.deviation.powi(2);
        let variance = rest.deviation.powi(2) - slope * self.covariance[(GRAVITY, REST)];
        let value = rest.value - slope * weight.value;
        Measurement { value, deviation: variance.max(0.0).sqrt() }
    }

    /// The scale of the weight by that of the rest.
    pub fn share_of_weight(&self) -> Measurement {
        let [weight, rest] = [GRAVITY, REST].map(|column| self.measurement(column));
        let value = weight.value / rest.value;
        let variance = weight.deviation.powi(2) - 2.0 * value * self.covariance[(GRAVITY, REST)]
            + (value * rest.deviation).powi(2);
        Measurement { value, deviation: variance.max(0.0).sqrt() / rest.value.abs() }
    }

    /// The squared distance of weight and rest from a common scale, in standard deviations.
    pub fn square_of_difference(&self) -> f64 {
        let (difference, variance) = self.difference();
        difference.powi(2) / variance
    }

    /// The squared distance of the weight from 0, in standard deviations.
    pub fn square_of_weight(&self) -> f64 {
        let weight = self.measurement(GRAVITY);
        (weight.value / weight.deviation).powi(2)
    }

    /// The weight's scale less that of the rest, and its variance.
    fn difference(&self) -> (f64, f64) {
        let [weight, rest] = [GRAVITY, REST].map(|column| self.measurement(column));
        let shared = self.covariance[(GRAVITY, REST)];
        let variance = weight.deviation.powi(2) + rest.deviation.powi(2) - 2.0 * shared;
        (weight.value - rest.value, variance.max(f64::MIN_POSITIVE))
    }

    /// The magnitude of the scale of the torques: that of their weight and that of the rest, each as
    /// far as it is known.
    fn size_of_scale(&self) -> f64 {
        let [gravity, rest] = [GRAVITY, REST].map(|column| {
            let value = self.coefficients[column].abs();
            (value, value.powi(2) / self.covariance[(column, column)])
        });
        let known = gravity.1 + rest.1;
        if known > 0.0 { (gravity.0 * gravity.1 + rest.0 * rest.1) / known } else { 0.0 }
    }
}
