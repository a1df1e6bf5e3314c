//! Matrix products in the calling thread. Linear maps, attention and convolutions use them.
//!
//! The accumulators of a register tile stay in registers. For each term, the tile loads one row of
//! the right factor as vectors, and broadcasts a column of the left factor number by number. Rows
//! of either factor may begin anywhere, so that a matrix of overlapping windows need not be written
//! out.
//!
//! A factor consists of f32, or of pairs of two terms as bf16. Processors with AVX-512 BF16 multiply
//! two pairs and add both products in one instruction. On others, pairs are extended to f32.

mod arithmetic;
#[cfg(test)]
mod tests;
mod tiles;

use std::mem::MaybeUninit;

use simd::{InstructionSet, Unfused};

use super::instruction_set::detected;
use super::pairs::Pair;
use super::vectorized;
#[cfg(target_arch = "x86_64")]
use arithmetic::Pairs;
use arithmetic::{Arithmetic, ExtendedPairs, Singles, widest};

/// Where the rows or the terms of a factor begin. The greatest offset is found once, and each
/// product checks it.
#[derive(Clone, Copy)]
pub(super) struct Offsets<'a> {
    each: &'a [usize],
    greatest: usize,
}

impl<'a> Offsets<'a> {
    pub fn of(each: &'a [usize]) -> Self {
        let mut greatest = 0;
        vectorized::furthest(each, &mut greatest);
        Self { each, greatest }
    }

    pub fn each(self) -> &'a [usize] {
        self.each
    }

    pub fn count(self) -> usize {
        self.each.len()
    }
}

/// The left factor. Element (row m, term k) is `values[rows[m] + k step]`.
#[derive(Clone, Copy)]
pub(super) struct Left<'a, N = f32> {
    pub values: &'a [N],
    pub rows: Offsets<'a>,
    pub step: usize,
}

/// The right factor. Element (term k, column n) is `values[terms[k] + n]`.
#[derive(Clone, Copy)]
pub(super) struct Right<'a, N = f32> {
    pub values: &'a [N],
    pub terms: Offsets<'a>,
}

/// The initial value to which the product is added.
#[derive(Clone, Copy)]
pub(super) enum Onto<'a> {
    Nothing,
    /// The output itself, which must consist of numbers.
    Output,
    /// A value for each column, the same in all rows.
    Columns(&'a [f32]),
    /// A value for each row, the same in all columns.
    Rows(&'a [f32]),
}

/// An element of an output: a number, or memory for one.
pub(super) trait Element {
    const IS_NUMBER: bool;
}

impl Element for f32 {
    const IS_NUMBER: bool = true;
}

impl Element for MaybeUninit<f32> {
    const IS_NUMBER: bool = false;
}

/// Writes `left · right` with `columns` columns to every row of `output`. The rows have the stride
/// `stride`.
pub(super) fn multiply<N: Number, E: Element>(
    left: Left<'_, N>,
    right: Right<'_, N>,
    onto: Onto<'_>,
    output: &mut [E],
    columns: usize,
    stride: usize,
) {
    let (rows, depth) = (left.rows.count(), right.terms.count());
    if rows == 0 || columns == 0 {
        return;
    }
    if depth > 0 {
        assert!(left.rows.greatest + (depth - 1) * left.step < left.values.len());
        assert!(right.terms.greatest + columns <= right.values.len());
    }
    assert!(columns <= stride && (rows - 1) * stride + columns <= output.len());
    match onto {
        Onto::Columns(numbers) => assert_eq!(numbers.len(), columns),
        Onto::Rows(numbers) => assert_eq!(numbers.len(), rows),
        Onto::Output => assert!(E::IS_NUMBER),
        Onto::Nothing => {}
    }
    let output = output.as_mut_ptr().cast();
    let product = Product { left, right, onto, output, columns, stride };
    // SAFETY: the processor has the instructions, and by the assertions above every element that
    // the sizes and offsets reach lies in its slice. An output without numbers is read only where
    // the product has written before.
    unsafe { N::compute(&product, detected()) };
}

/// Columns of the right factor that a tile reads, if there are as many.
pub(super) fn tile_columns() -> usize {
    match detected() {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512(_) => widest::<simd::F32x16>(),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2(_) => widest::<simd::F32x8>(),
        InstructionSet::Portable => widest::<Unfused>(),
    }
}

/// A number of a factor in memory. It has the 32 bits of an f32.
pub(super) trait Number: Copy {
    /// # Safety
    /// The processor must have the instructions, and every element that the sizes and offsets reach
    /// must lie in its slice.
    unsafe fn compute(product: &Product<'_, Self>, set: InstructionSet);
}

impl Number for f32 {
    unsafe fn compute(product: &Product<'_, Self>, set: InstructionSet) {
        // SAFETY: the caller guarantees it.
        unsafe {
            match set {
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512(_) => avx512::<Singles>(product),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2(_) => avx2::<Singles>(product),
                InstructionSet::Portable => plain::<Singles>(product),
            }
        }
    }
}

impl Number for Pair {
    unsafe fn compute(product: &Product<'_, Self>, set: InstructionSet) {
        // SAFETY: the caller guarantees it.
        unsafe {
            match set {
                #[cfg(target_arch = "x86_64")]
                set if set.multiplies_bf16() => avx512_bf16(product),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx512(_) => avx512::<ExtendedPairs>(product),
                #[cfg(target_arch = "x86_64")]
                InstructionSet::Avx2(_) => avx2::<ExtendedPairs>(product),
                InstructionSet::Portable => plain::<ExtendedPairs>(product),
            }
        }
    }
}

/// A product whose sizes and offsets were checked.
pub(super) struct Product<'a, N> {
    left: Left<'a, N>,
    right: Right<'a, N>,
    onto: Onto<'a>,
    output: *mut f32,
    columns: usize,
    stride: usize,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bf16")]
unsafe fn avx512_bf16(product: &Product<'_, Pair>) {
    // SAFETY: see `multiply`.
    unsafe { product.all_columns::<simd::F32x16, Pairs>() };
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn avx512<A: Arithmetic<simd::F32x16>>(product: &Product<'_, A::Number>) {
    // SAFETY: see `multiply`.
    unsafe { product.all_columns::<simd::F32x16, A>() };
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn avx2<A: Arithmetic<simd::F32x8>>(product: &Product<'_, A::Number>) {
    // SAFETY: see `multiply`.
    unsafe { product.all_columns::<simd::F32x8, A>() };
}

#[inline(never)]
unsafe fn plain<A: Arithmetic<Unfused>>(product: &Product<'_, A::Number>) {
    // SAFETY: see `multiply`.
    unsafe { product.all_columns::<Unfused, A>() };
}
