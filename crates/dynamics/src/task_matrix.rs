//! Symmetric positive definite matrices of the hand's task.

use simd::Lanes;

use crate::forward_dynamics::FactoredMass;
use crate::hand::{Jacobian, MOTION};

/// A symmetric matrix, given on and below the diagonal.
pub(crate) type TaskMatrix<L> = [[L; MOTION]; MOTION];

/// Evaluates `$body` for each row, in the given order. The compiler does not unroll loops over rows
/// that have a shorter loop inside.
macro_rules! for_each_row {
    ($row:ident in $($number:literal)*, $body:block) => {$({
        let $row: usize = $number;
        $body
    })*};
}

/// Factors of a matrix: L D Lᵀ, with ones on the diagonal of L.
#[derive(Clone, Copy)]
pub(crate) struct Factors<L> {
    lower: [[L; MOTION]; MOTION],
    /// 1 / D.
    inverse: [L; MOTION],
    /// Above 0 where the matrix is singular.
    pub(crate) singular: L,
}

impl<L: Lanes> Factors<L> {
    /// The factors of a task's matrix. `turning` is 1 if the task has the hand's orientation. If it
    /// is 0, the last three rows are made independent of the others. The matrix is singular where
    /// a pivot is below the share `least_pivot` of the entry that it comes from.
    #[inline(always)]
    pub(crate) fn of(matrix: &TaskMatrix<L>, turning: L, least_pivot: f64) -> Self {
        let zero = L::splat(0.0);
        let missing = L::splat(1.0) - turning;
        let mut matrix = *matrix;
        for row in MOTION / 2..MOTION {
            matrix[row][row] = matrix[row][row] + missing;
        }
        let mut rest = matrix;
        let mut factors = Self {
            lower: [[zero; MOTION]; MOTION],
            inverse: [zero; MOTION],
            singular: L::splat(-1.0),
        };
        for_each_row!(pivot in 0 1 2 3 4 5, {
            let least = matrix[pivot][pivot] * L::splat(least_pivot);
            let entry = rest[pivot][pivot];
            factors.singular = factors.singular.max(least - entry);
            // A singular lane is noticed later. Until then its numbers stay finite.
            let bound = least.max(L::splat(f64::from(f32::MIN_POSITIVE)));
            let inverse = entry.max(bound).recip();
            factors.inverse[pivot] = inverse;
            for row in pivot + 1..MOTION {
                factors.lower[row][pivot] = rest[row][pivot] * inverse;
            }
            for column in pivot + 1..MOTION {
                for row in column..MOTION {
                    let factor = factors.lower[row][pivot];
                    rest[row][column] =
                        factor.neg_mul_add(rest[column][pivot], rest[row][column]);
                }
            }
        });
        factors
    }

    /// `b` becomes the solution of the equations with this matrix.
    #[inline(always)]
    pub(crate) fn solve(&self, b: &mut [L; MOTION]) {
        for_each_row!(column in 0 1 2 3 4, {
            for row in column + 1..MOTION {
                b[row] = self.lower[row][column].neg_mul_add(b[column], b[row]);
            }
        });
        for row in 0..MOTION {
            b[row] = b[row] * self.inverse[row];
        }
        for_each_row!(later in 5 4 3 2 1, {
            for row in 0..later {
                b[row] = self.lower[later][row].neg_mul_add(b[later], b[row]);
            }
        });
    }
}

/// The Jacobian of a task, and intermediate results of its matrix. A simulation allocates them once,
/// because filling them with zeros takes time. So does copying a Jacobian that a function returns.
pub(crate) struct Scratch<L, const N: usize> {
    /// That of the hand at the present posture.
    pub(crate) jacobian: Jacobian<L, N>,
    /// Rows of the Jacobian times the inverse of a factor of the mass matrix.
    reduced: [[L; N]; MOTION],
    matrix: TaskMatrix<L>,
}

impl<L: Lanes, const N: usize> Scratch<L, N> {
    pub(crate) fn new() -> Self {
        let zero = L::splat(0.0);
        Self {
            jacobian: Jacobian::zero(),
            reduced: [[zero; N]; MOTION],
            matrix: [[zero; MOTION]; MOTION],
        }
    }

    /// J M⁻¹ Jᵀ: how much the hand gives way to a force.
    #[inline(always)]
    pub(crate) fn compliance(
        &mut self,
        joints: usize,
        mass: &FactoredMass<L, N>,
    ) -> &TaskMatrix<L> {
        let Self { jacobian, reduced, matrix } = self;
        // A loop, because copies for all rows do not fit into the instruction cache with the rest.
        for row in 0..MOTION {
            let mut entries = jacobian.rows[row];
            for pivot in (1..joints).rev() {
                for joint in 0..pivot {
                    let factor = mass.factors[pivot][joint];
                    entries[joint] = factor.neg_mul_add(entries[pivot], entries[joint]);
                }
            }
            reduced[row] = entries;
            for joint in 0..joints {
                entries[joint] = entries[joint] * mass.inverse_pivots[joint];
            }
            for column in 0..=row {
                matrix[row][column] = product(joints, &entries, &reduced[column]);
            }
        }
        matrix
    }

    /// J Jᵀ.
    #[inline(always)]
    pub(crate) fn gram(&mut self, joints: usize) -> &TaskMatrix<L> {
        let Self { jacobian, matrix, .. } = self;
        for row in 0..MOTION {
            for column in 0..=row {
                let (a, b) = (&jacobian.rows[row], &jacobian.rows[column]);
                matrix[row][column] = product(joints, a, b);
            }
        }
        matrix
    }
}

#[inline(always)]
fn product<L: Lanes, const N: usize>(joints: usize, a: &[L; N], b: &[L; N]) -> L {
    let mut product = a[0] * b[0];
    for joint in 1..joints {
        product = a[joint].mul_add(b[joint], product);
    }
    product
}
