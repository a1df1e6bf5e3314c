//! The numbers of factors, and their products in vectors.

use simd::{Unfused, Vector};

use super::super::pairs::Pair;
use super::Number;

/// Vectors with the sizes of their register tiles.
pub(super) trait Tiled: Vector {
    /// Largest number of rows of a tile that is 1, 2, 3 or 4 vectors wide; 0 where there is none.
    /// The accumulators of a tile, one row of vectors and one broadcast number fit in the
    /// registers.
    const ROWS: [usize; 4];

    /// The same for [`ExtendedPairs`], which need twice as many registers for a row and a number.
    /// The widest tile is as wide.
    const ROWS_OF_EXTENDED: [usize; 4];
}

impl Tiled for Unfused {
    const ROWS: [usize; 4] = [6, 4, 0, 0];
    const ROWS_OF_EXTENDED: [usize; 4] = [4, 2, 0, 0];
}

#[cfg(target_arch = "x86_64")]
impl Tiled for simd::F32x8 {
    const ROWS: [usize; 4] = [8, 6, 0, 0];
    const ROWS_OF_EXTENDED: [usize; 4] = [8, 4, 0, 0];
}

#[cfg(target_arch = "x86_64")]
impl Tiled for simd::F32x16 {
    const ROWS: [usize; 4] = [12, 12, 8, 6];
    const ROWS_OF_EXTENDED: [usize; 4] = [12, 12, 6, 4];
}

/// Columns of the widest tile.
pub(super) const fn widest<V: Tiled>() -> usize {
    let mut vectors = 4;
    while V::ROWS[vectors - 1] == 0 {
        vectors -= 1;
    }
    vectors * V::LANES
}

/// The arithmetic on the numbers of factors with vectors `V`.
pub(super) trait Arithmetic<V: Vector> {
    type Number: Number;

    /// A vector of the right factor, or one number of the left factor in every lane.
    type Values: Copy;

    /// Rows of tiles, as in [`Tiled::ROWS`].
    const TILE_ROWS: [usize; 4];

    /// # Safety
    /// The processor must have the instructions.
    unsafe fn values(vector: V) -> Self::Values;

    /// # Safety
    /// The processor must have the instructions.
    unsafe fn mul_add(values: Self::Values, factor: Self::Values, sum: V) -> V;
}

/// Factors of f32.
pub(super) struct Singles;

impl<V: Tiled> Arithmetic<V> for Singles {
    type Number = f32;
    type Values = V;
    const TILE_ROWS: [usize; 4] = V::ROWS;

    #[inline(always)]
    unsafe fn values(vector: V) -> V {
        vector
    }

    #[inline(always)]
    unsafe fn mul_add(values: V, factor: V, sum: V) -> V {
        // SAFETY: the caller guarantees the instructions.
        unsafe { values.mul_add(factor, sum) }
    }
}

/// Factors of pairs, which the processor multiplies.
#[cfg(target_arch = "x86_64")]
pub(super) struct Pairs;

#[cfg(target_arch = "x86_64")]
impl Arithmetic<simd::F32x16> for Pairs {
    type Number = Pair;
    type Values = simd::F32x16;
    const TILE_ROWS: [usize; 4] = simd::F32x16::ROWS;

    #[inline(always)]
    unsafe fn values(vector: simd::F32x16) -> simd::F32x16 {
        vector
    }

    #[inline(always)]
    unsafe fn mul_add(
        values: simd::F32x16,
        factor: simd::F32x16,
        sum: simd::F32x16,
    ) -> simd::F32x16 {
        // SAFETY: the caller guarantees the instructions.
        unsafe { values.mul_add_halves(factor, sum) }
    }
}

/// Factors of pairs, whose halves are multiplied as f32.
pub(super) struct ExtendedPairs;

impl<V: Tiled> Arithmetic<V> for ExtendedPairs {
    type Number = Pair;
    type Values = [V; 2];
    const TILE_ROWS: [usize; 4] = V::ROWS_OF_EXTENDED;

    #[inline(always)]
    unsafe fn values(vector: V) -> [V; 2] {
        // SAFETY: the caller guarantees the instructions.
        unsafe { vector.halves() }
    }

    #[inline(always)]
    unsafe fn mul_add(values: [V; 2], factor: [V; 2], sum: V) -> V {
        // SAFETY: the caller guarantees the instructions.
        unsafe {
            let sum = values[1].mul_add(factor[1], sum);
            values[0].mul_add(factor[0], sum)
        }
    }
}
