//! Solution of a small linear system in every lane.

use simd::Lanes;
use spec::MAX_JOINTS;

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
