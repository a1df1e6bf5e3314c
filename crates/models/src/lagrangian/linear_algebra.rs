//! Linear algebra in lanes: the dense layers of the network, and small linear systems.

use simd::Lanes;
use spec::MAX_JOINTS;

/// Outputs of a layer that are computed together.
pub(super) const TILE: usize = 8;

/// A layer, packed for lanes.
#[derive(Debug)]
pub(super) struct Dense {
    pub inputs: usize,
    pub outputs: usize,
    /// `[tile, input, output of the tile]`; 0 beyond the last output.
    weights: Vec<[f32; TILE]>,
    /// `[tile, output of the tile]`
    biases: Vec<[f32; TILE]>,
}

impl Dense {
    /// From a weight `[output, input]` and a bias `[output]`.
    pub fn new(weight: &[f32], bias: &[f32]) -> Self {
        let outputs = bias.len();
        let inputs = weight.len() / outputs;
        let tiles = outputs.div_ceil(TILE);
        let mut weights = vec![[0.0; TILE]; tiles * inputs];
        let mut biases = vec![[0.0; TILE]; tiles];
        for (output, (row, &bias)) in weight.chunks_exact(inputs).zip(bias).enumerate() {
            let (tile, lane) = (output / TILE, output % TILE);
            biases[tile][lane] = bias;
            for (input, &weight) in row.iter().enumerate() {
                weights[tile * inputs + input][lane] = weight;
            }
        }
        Self { inputs, outputs, weights, biases }
    }

    /// `y = W x + b`; `y` has room for whole tiles.
    #[inline(always)]
    pub fn apply<L: Lanes>(&self, x: &[L], y: &mut [L]) {
        let tiles = self.weights.chunks_exact(self.inputs).zip(&self.biases);
        for ((weights, biases), y) in tiles.zip(y.as_chunks_mut::<TILE>().0) {
            let mut sums = [L::splat(0.0); TILE];
            for output in 0..TILE {
                sums[output] = L::splat(f64::from(biases[output]));
            }
            for input in 0..self.inputs {
                for output in 0..TILE {
                    let weight = L::splat(f64::from(weights[input][output]));
                    sums[output] = weight.mul_add(x[input], sums[output]);
                }
            }
            *y = sums;
        }
    }

    /// [`Dense::apply`] with derivatives: `x` and `y` are `[values, rates of change]`.
    #[inline(always)]
    pub fn apply_moving<L: Lanes>(&self, x: [&[L]; 2], y: [&mut [L]; 2]) {
        let ([x, rates], [y, rates_after]) = (x, y);
        let tiles = self.weights.chunks_exact(self.inputs).zip(&self.biases);
        let places =
            y.as_chunks_mut::<TILE>().0.iter_mut().zip(rates_after.as_chunks_mut::<TILE>().0);
        for ((weights, biases), (y, rates_after)) in tiles.zip(places) {
            let mut sums = [L::splat(0.0); TILE];
            let mut changes = [L::splat(0.0); TILE];
            for output in 0..TILE {
                sums[output] = L::splat(f64::from(biases[output]));
            }
            for input in 0..self.inputs {
                for output in 0..TILE {
                    let weight = L::splat(f64::from(weights[input][output]));
                    sums[output] = weight.mul_add(x[input], sums[output]);
                    changes[output] = weight.mul_add(rates[input], changes[output]);
                }
            }
            *y = sums;
            *rates_after = changes;
        }
    }
}

/// tanh x = 1 - 2 / (e²ˣ + 1), to about 10⁻⁷; beyond ±20 it is ±1 in single precision.
#[inline(always)]
pub(super) fn tanh<L: Lanes>(x: L) -> L {
    let x = bounded(x, L::splat(-20.0), L::splat(20.0));
    let power = (x + x).exp();
    (power + L::splat(1.0)).recip().mul_add(L::splat(-2.0), L::splat(1.0))
}

/// `x` clamped to `least` to `most`.
#[inline(always)]
pub(super) fn bounded<L: Lanes>(x: L, least: L, most: L) -> L {
    -((-x.max(least)).max(-most))
}

/// A positive definite matrix as L D Lᵀ, with ones on the diagonal of L.
pub(super) struct Factored<L> {
    /// Entries of L below the diagonal.
    lower: [[L; MAX_JOINTS]; MAX_JOINTS],
    /// 1 / D.
    inverse: [L; MAX_JOINTS],
    /// The least pivot: the minimum over the entries of D, before they were raised, of the ratio to
    /// `least`.
    pub least: L,
}

impl<L: Lanes> Factored<L> {
    /// Factors the lower triangle of a matrix. Entries of D below `least` are raised to it. The sum
    /// of the diagonal matrix `least` and a positive semidefinite matrix has no such entry.
    #[inline(always)]
    pub fn new(
        joints: usize,
        mut matrix: [[L; MAX_JOINTS]; MAX_JOINTS],
        least: &[L; MAX_JOINTS],
    ) -> Self {
        let mut inverse = [L::splat(0.0); MAX_JOINTS];
        let zero = L::splat(0.0);
        // Lanes have no minimum. It is the negated maximum of the negated values.
        let mut negative = zero - L::splat(f64::from(f32::MAX));
        for column in 0..joints {
            negative = negative.max(zero - matrix[column][column] * least[column].recip());
            inverse[column] = matrix[column][column].max(least[column]).recip();
            let mut entries = [L::splat(0.0); MAX_JOINTS];
            for row in column + 1..joints {
                entries[row] = matrix[row][column];
            }
            for row in column + 1..joints {
                let share = entries[row] * inverse[column];
                for other in column + 1..=row {
                    matrix[row][other] = share.neg_mul_add(entries[other], matrix[row][other]);
                }
                matrix[row][column] = share;
            }
        }
        Self { lower: matrix, inverse, least: zero - negative }
    }

    #[inline(always)]
    pub fn solve(&self, joints: usize, x: &mut [L; MAX_JOINTS]) {
        for row in 0..joints {
            for column in 0..row {
                x[row] = self.lower[row][column].neg_mul_add(x[column], x[row]);
            }
        }
        for row in (0..joints).rev() {
            x[row] = x[row] * self.inverse[row];
            for below in row + 1..joints {
                x[row] = self.lower[below][row].neg_mul_add(x[below], x[row]);
            }
        }
    }
}
