//! Transposition of matrices in blocks.

use simd::InstructionSet;

use super::instruction_set::detected;

/// Transposes a block from `from` to `to`. The strides are those of the rows.
type Block = unsafe fn(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize);

/// The number of rows and columns of a square block that fits in registers, and its function.
fn block() -> Option<(usize, Block)> {
    match detected() {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512(_) => Some((16, avx512::block)),
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2(_) => Some((8, avx2::block)),
        InstructionSet::Portable => None,
    }
}

/// Writes element (r, c) of `from` to element (c, r) of `to`. The strides are those of the rows.
pub(super) fn transpose(
    from: &[f32],
    [rows, columns]: [usize; 2],
    from_stride: usize,
    to: &mut [f32],
    to_stride: usize,
) {
    if rows == 0 || columns == 0 {
        return;
    }
    assert!(columns <= from_stride && (rows - 1) * from_stride + columns <= from.len());
    assert!(rows <= to_stride && (columns - 1) * to_stride + rows <= to.len());
    let (mut whole_rows, mut whole_columns) = (0, 0);
    if let Some((size, block)) = block() {
        (whole_rows, whole_columns) = (rows / size * size, columns / size * size);
        for row in (0..whole_rows).step_by(size) {
            for column in (0..whole_columns).step_by(size) {
                // SAFETY: the processor has the instructions, and by the assertions above the block
                // lies inside both.
                unsafe {
                    block(
                        from.as_ptr().add(row * from_stride + column),
                        from_stride,
                        to.as_mut_ptr().add(column * to_stride + row),
                        to_stride,
                    );
                }
            }
        }
    }
    for row in 0..rows {
        let first = if row < whole_rows { whole_columns } else { 0 };
        for column in first..columns {
            to[column * to_stride + row] = from[row * from_stride + column];
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx512 {
    use std::arch::x86_64::*;

    /// Interleaves pairs of rows, then pairs of pairs, then pairs of fours.
    #[target_feature(enable = "avx512f")]
    pub unsafe fn block(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize) {
        let mut rows = [_mm512_setzero_ps(); 16];
        for (index, row) in rows.iter_mut().enumerate() {
            // SAFETY: the caller guarantees that the block can be read.
            *row = unsafe { _mm512_loadu_ps(from.add(index * from_stride)) };
        }
        // Quarter q of register 4 g + c has column 4 q + c of the rows 4 g to 4 g + 3.
        let mut fours = [_mm512_setzero_ps(); 16];
        for group in (0..16).step_by(4) {
            let [a, b, c, d] = [rows[group], rows[group + 1], rows[group + 2], rows[group + 3]];
            let pairs = [
                _mm512_unpacklo_ps(a, b),
                _mm512_unpackhi_ps(a, b),
                _mm512_unpacklo_ps(c, d),
                _mm512_unpackhi_ps(c, d),
            ]
            .map(|pair| _mm512_castps_pd(pair));
            fours[group] = _mm512_castpd_ps(_mm512_unpacklo_pd(pairs[0], pairs[2]));
            fours[group + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(pairs[0], pairs[2]));
            fours[group + 2] = _mm512_castpd_ps(_mm512_unpacklo_pd(pairs[1], pairs[3]));
            fours[group + 3] = _mm512_castpd_ps(_mm512_unpackhi_pd(pairs[1], pairs[3]));
        }
        for column in 0..4 {
            let [a, b] = [fours[column], fours[4 + column]];
            let [c, d] = [fours[8 + column], fours[12 + column]];
            let even = [_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0x88>(c, d)];
            let odd = [_mm512_shuffle_f32x4::<0xdd>(a, b), _mm512_shuffle_f32x4::<0xdd>(c, d)];
            let results = [
                _mm512_shuffle_f32x4::<0x88>(even[0], even[1]),
                _mm512_shuffle_f32x4::<0x88>(odd[0], odd[1]),
                _mm512_shuffle_f32x4::<0xdd>(even[0], even[1]),
                _mm512_shuffle_f32x4::<0xdd>(odd[0], odd[1]),
            ];
            for (quarter, result) in results.into_iter().enumerate() {
                // SAFETY: the caller guarantees that the block can be written.
                unsafe { _mm512_storeu_ps(to.add((4 * quarter + column) * to_stride), result) };
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    /// Interleaves pairs of rows, then pairs of pairs, then pairs of fours.
    #[target_feature(enable = "avx2")]
    pub unsafe fn block(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize) {
        let mut rows = [_mm256_setzero_ps(); 8];
        for (index, row) in rows.iter_mut().enumerate() {
            // SAFETY: the caller guarantees that the block can be read.
            *row = unsafe { _mm256_loadu_ps(from.add(index * from_stride)) };
        }
        // Half h of register 4 g + c has column 4 h + c of the rows 4 g to 4 g + 3.
        let mut fours = [_mm256_setzero_ps(); 8];
        for group in [0, 4] {
            let [a, b, c, d] = [rows[group], rows[group + 1], rows[group + 2], rows[group + 3]];
            let low = [_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d)];
            let high = [_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d)];
            fours[group] = _mm256_shuffle_ps::<0x44>(low[0], low[1]);
            fours[group + 1] = _mm256_shuffle_ps::<0xee>(low[0], low[1]);
            fours[group + 2] = _mm256_shuffle_ps::<0x44>(high[0], high[1]);
            fours[group + 3] = _mm256_shuffle_ps::<0xee>(high[0], high[1]);
        }
        for column in 0..4 {
            let [a, b] = [fours[column], fours[4 + column]];
            let halves =
                [_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b)];
            for (half, result) in halves.into_iter().enumerate() {
                // SAFETY: the caller guarantees that the block can be written.
                unsafe { _mm256_storeu_ps(to.add((4 * half + column) * to_stride), result) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::instruction_set;
    use super::transpose;

    #[test]
    fn every_element_changes_row_and_column_and_none_else_is_touched() {
        for [rows, columns] in [[1, 1], [3, 40], [16, 16], [17, 33], [64, 20], [48, 50]] {
            instruction_set::tests::with_each(|set| {
                let (from_stride, to_stride) = (columns + 5, rows + 2);
                let from: Vec<f32> = (0..rows * from_stride).map(|index| index as f32).collect();
                let mut to = vec![-1.0; columns * to_stride];
                transpose(&from, [rows, columns], from_stride, &mut to, to_stride);
                for (c, row) in to.chunks(to_stride).enumerate() {
                    for (r, &value) in row.iter().enumerate() {
                        let expected = if r < rows { from[r * from_stride + c] } else { -1.0 };
                        assert_eq!(value, expected, "{set:?} {rows}x{columns}");
                    }
                }
            });
        }
    }
}
