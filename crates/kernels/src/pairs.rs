//! Neighbouring terms of a product as pairs of bf16 numbers.
//!
//! A bf16 is an f32 without the lower sixteen bits. It keeps the range of an f32 and eight of its
//! 24 significant bits. Numbers are rounded to the nearest bf16, ties to even.

use super::instruction_set::detected;
use super::vectorized::vectorized;

/// Two terms of a factor, as bf16. The first is in the low half.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub(super) struct Pair(u32);

impl Pair {
    #[inline(always)]
    pub fn of(first: f32, second: f32) -> Self {
        Self(rounded(first) >> 16 | rounded(second) & 0xffff_0000)
    }

    #[cfg(test)]
    pub fn halves(self) -> [f32; 2] {
        [f32::from_bits(self.0 << 16), f32::from_bits(self.0 & 0xffff_0000)]
    }

    /// The bits of pairs as those of floats, to copy them.
    pub fn as_floats(pairs: &[Self]) -> &[f32] {
        // SAFETY: both types have 32 bits, and every pattern is a value.
        unsafe { std::slice::from_raw_parts(pairs.as_ptr().cast(), pairs.len()) }
    }

    pub fn as_floats_mut(pairs: &mut [Self]) -> &mut [f32] {
        // SAFETY: see above.
        unsafe { std::slice::from_raw_parts_mut(pairs.as_mut_ptr().cast(), pairs.len()) }
    }
}

/// The bits of the nearest bf16 in the high half. The low half is not cleared.
#[inline(always)]
fn rounded(value: f32) -> u32 {
    let bits = value.to_bits();
    if value.is_nan() {
        // Rounding could carry into the sign. This sets a bit of the high half that marks a NaN.
        return bits | 0x0040_0000;
    }
    bits + 0x7fff + (bits >> 16 & 1)
}

/// Writes pairs of neighbouring values of some rows. A row has `depth` values from its offset in
/// `rows` on, and the last one of an odd number is followed by 0. The rows of `pairs` have the
/// stride `stride`.
pub(super) fn along_rows(
    values: &[f32],
    rows: &[usize],
    depth: usize,
    pairs: &mut [Pair],
    stride: usize,
) {
    match detected() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has the instructions.
        set if set.multiplies_bf16() => unsafe {
            avx512_bf16::along_rows(values, rows, depth, pairs, stride);
        },
        _ => along_rows_by_shifts(values, rows, depth, pairs, stride),
    }
}

/// Writes pairs of the values at the same place of two consecutive rows. `values` has `depth` rows
/// with the stride `row_stride`, and the last one of an odd number is followed by zeros. The rows
/// of `pairs` have the stride `stride`.
pub(super) fn across_rows(
    values: &[f32],
    row_stride: usize,
    [depth, columns]: [usize; 2],
    pairs: &mut [Pair],
    stride: usize,
) {
    match detected() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has the instructions.
        set if set.multiplies_bf16() => unsafe {
            avx512_bf16::across_rows(values, row_stride, [depth, columns], pairs, stride);
        },
        _ => across_rows_by_shifts(values, row_stride, [depth, columns], pairs, stride),
    }
}

vectorized! {
    fn along_rows_by_shifts(
        values: &[f32],
        rows: &[usize],
        depth: usize,
        pairs: &mut [Pair],
        stride: usize,
    ) {
        for (&row, pairs) in rows.iter().zip(pairs.chunks_mut(stride)) {
            pairs_along(&values[row..][..depth], pairs);
        }
    }
}

vectorized! {
    fn across_rows_by_shifts(
        values: &[f32],
        row_stride: usize,
        extent: [usize; 2],
        pairs: &mut [Pair],
        stride: usize,
    ) {
        let [depth, columns] = extent;
        for (index, pairs) in pairs.chunks_mut(stride).take(depth.div_ceil(2)).enumerate() {
            let [first, second] = two_rows(values, row_stride, [depth, columns], 2 * index);
            pairs_across(first, second, &mut pairs[..columns]);
        }
    }
}

#[inline(always)]
fn pairs_along(values: &[f32], pairs: &mut [Pair]) {
    let (values, rest) = values.as_chunks::<2>();
    let (whole, last) = pairs.split_at_mut(values.len());
    for (pair, &[first, second]) in whole.iter_mut().zip(values) {
        *pair = Pair::of(first, second);
    }
    if let [value] = rest {
        last[0] = Pair::of(*value, 0.0);
    }
}

/// `second` is empty after the last row.
#[inline(always)]
fn pairs_across(first: &[f32], second: &[f32], pairs: &mut [Pair]) {
    if second.is_empty() {
        for (pair, &first) in pairs.iter_mut().zip(first) {
            *pair = Pair::of(first, 0.0);
        }
        return;
    }
    for ((pair, &first), &second) in pairs.iter_mut().zip(first).zip(second) {
        *pair = Pair::of(first, second);
    }
}

/// The rows `row` and `row + 1`. The second one is empty after the last row.
#[inline(always)]
fn two_rows(
    values: &[f32],
    row_stride: usize,
    [depth, columns]: [usize; 2],
    row: usize,
) -> [&[f32]; 2] {
    let first = &values[row * row_stride..][..columns];
    let second = if row + 1 < depth { &values[(row + 1) * row_stride..][..columns] } else { &[] };
    [first, second]
}

#[cfg(target_arch = "x86_64")]
mod avx512_bf16 {
    use std::arch::x86_64::*;

    use super::{Pair, pairs_across, pairs_along, two_rows};

    /// # Safety
    /// The processor must have the instructions.
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bf16")]
    pub unsafe fn along_rows(
        values: &[f32],
        rows: &[usize],
        depth: usize,
        pairs: &mut [Pair],
        stride: usize,
    ) {
        for (&row, pairs) in rows.iter().zip(pairs.chunks_mut(stride)) {
            let (blocks, rest) = values[row..][..depth].as_chunks::<32>();
            let (whole, pairs) = pairs.split_at_mut(blocks.len() * 16);
            for (place, block) in whole.as_chunks_mut::<16>().0.iter_mut().zip(blocks) {
                // SAFETY: the block has the length of two vectors, and the place that of one.
                unsafe {
                    let first = _mm512_loadu_ps(block.as_ptr());
                    let second = _mm512_loadu_ps(block.as_ptr().add(16));
                    let numbers = _mm512_cvtne2ps_pbh(second, first);
                    place.as_mut_ptr().cast::<__m512bh>().write_unaligned(numbers);
                }
            }
            let (blocks, rest) = rest.as_chunks::<16>();
            let (half, last) = pairs.split_at_mut(blocks.len() * 8);
            for (place, block) in half.as_chunks_mut::<8>().0.iter_mut().zip(blocks) {
                // SAFETY: both have the length of the vectors.
                unsafe {
                    let numbers = _mm512_cvtneps_pbh(_mm512_loadu_ps(block.as_ptr()));
                    place.as_mut_ptr().cast::<__m256bh>().write_unaligned(numbers);
                }
            }
            pairs_along(rest, last);
        }
    }

    /// # Safety
    /// The processor must have the instructions.
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bf16")]
    pub unsafe fn across_rows(
        values: &[f32],
        row_stride: usize,
        [depth, columns]: [usize; 2],
        pairs: &mut [Pair],
        stride: usize,
    ) {
        // Lane n of the low half, then lane n of the high half, which begins with the 16th number.
        let counted = _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
        let second = _mm512_slli_epi32::<16>(_mm512_add_epi32(counted, _mm512_set1_epi32(16)));
        let interleaved = _mm512_or_si512(counted, second);
        for (index, pairs) in pairs.chunks_mut(stride).take(depth.div_ceil(2)).enumerate() {
            let [first, second] = two_rows(values, row_stride, [depth, columns], 2 * index);
            let pairs = &mut pairs[..columns];
            let (second_blocks, second_rest) = second.as_chunks::<16>();
            let (whole, last) = pairs.split_at_mut(second_blocks.len() * 16);
            let (first_whole, first_rest) = first.split_at(whole.len());
            let blocks = first_whole.as_chunks::<16>().0.iter().zip(second_blocks);
            for (place, (first, second)) in whole.as_chunks_mut::<16>().0.iter_mut().zip(blocks) {
                // SAFETY: all three have the length of the vectors.
                unsafe {
                    let first = _mm512_loadu_ps(first.as_ptr());
                    let second = _mm512_loadu_ps(second.as_ptr());
                    // The numbers of the first row are in the low half, those of the second after.
                    let numbers = _mm512_cvtne2ps_pbh(second, first);
                    let numbers = std::mem::transmute::<__m512bh, __m512i>(numbers);
                    let paired = _mm512_permutexvar_epi16(interleaved, numbers);
                    place.as_mut_ptr().cast::<__m512i>().write_unaligned(paired);
                }
            }
            pairs_across(first_rest, second_rest, last);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::instruction_set;
    use super::{Pair, across_rows, along_rows};

    /// Numbers with each kind of rounding, and those that have no digits to lose.
    const NUMBERS: [(f32, f32); 12] = [
        (1.0, 1.0),
        (-0.375, -0.375),
        (0.0, 0.0),
        // A bf16 has eight significant bits.
        (257.0, 256.0),
        (259.0, 260.0),
        (-258.9, -258.0),
        (258.99, 258.0),
        (3.0e38, 3.004_055_3e38),
        (f32::MAX, f32::INFINITY),
        (f32::NEG_INFINITY, f32::NEG_INFINITY),
        (1.2e-30, 1.201_780_3e-30),
        (0.1, 0.100_097_656),
    ];

    fn numbers(count: usize, shift: usize) -> (Vec<f32>, Vec<f32>) {
        (0..count).map(|index| NUMBERS[(index * 5 + shift) % NUMBERS.len()]).unzip()
    }

    const STRIDE: usize = 80;
    const UNTOUCHED: Pair = Pair(77);

    #[test]
    fn pairs_along_rows_have_the_nearest_numbers() {
        for depth in 1..70 {
            let (values, nearest) = numbers(3 * 75, depth);
            let rows = [150, 0, 75];
            instruction_set::tests::with_each(|set| {
                let mut pairs = [UNTOUCHED; 3 * STRIDE];
                along_rows(&values, &rows, depth, &mut pairs, STRIDE);
                for (pairs, row) in pairs.chunks(STRIDE).zip(rows) {
                    let (written, others) = pairs.split_at(depth.div_ceil(2));
                    let mut found: Vec<f32> =
                        written.iter().copied().flat_map(Pair::halves).collect();
                    assert!(found.drain(depth..).all(|after| after == 0.0), "{set}");
                    assert_eq!(found, nearest[row..][..depth], "{set}");
                    assert!(others.iter().all(|&pair| pair == UNTOUCHED), "{set}");
                }
            });
        }
    }

    #[test]
    fn pairs_across_rows_have_the_nearest_numbers() {
        for (depth, columns) in [(1, 3), (2, 16), (3, 17), (4, 64), (5, 33), (7, 1), (8, 50)] {
            let (values, nearest) = numbers(8 * 75, depth);
            instruction_set::tests::with_each(|set| {
                let mut pairs = [UNTOUCHED; 4 * STRIDE];
                across_rows(&values, 75, [depth, columns], &mut pairs, STRIDE);
                for (index, pairs) in pairs.chunks(STRIDE).enumerate() {
                    for (column, &pair) in pairs.iter().enumerate() {
                        if 2 * index >= depth || column >= columns {
                            assert_eq!(pair, UNTOUCHED, "{set}");
                            continue;
                        }
                        let row = |row| if row < depth { nearest[row * 75 + column] } else { 0.0 };
                        assert_eq!(pair.halves(), [row(2 * index), row(2 * index + 1)], "{set}");
                    }
                }
            });
        }
    }

    #[test]
    fn what_is_not_a_number_stays_so() {
        let values = [f32::NAN, f32::from_bits(0x7f80_0001), f32::from_bits(0xffff_ffff), -0.0];
        let values = [values; 16].concat();
        instruction_set::tests::with_each(|set| {
            let mut pairs = [Pair::default(); 64];
            across_rows(&[&values[..], &values[..]].concat(), 64, [2, 64], &mut pairs, 64);
            for pair in pairs.chunks(4) {
                let nan = |pair: Pair| pair.halves().iter().all(|half| half.is_nan());
                assert!(pair[..3].iter().all(|&pair| nan(pair)), "{set}");
                assert_eq!(pair[3].halves(), [0.0, 0.0]);
            }
        });
    }
}
