//! Matrix products in the calling thread. Linear maps, attention and convolutions use them.
//!
//! The accumulators of a register tile stay in registers. For each term, the tile loads one row of
//! the right factor as vectors, and broadcasts a column of the left factor number by number. Rows
//! of either factor may begin anywhere, so that a matrix of overlapping windows need not be written
//! out.

use simd::{InstructionSet, Unfused, Vector};

use super::instruction_set::detected;
use super::vectorized;

/// Terms that are summed in registers before they are added to the output. A sum of sums has
/// smaller rounding errors than a long sum, and norms of few samples magnify rounding errors.
const TERMS: usize = 128;

/// The left factor. Element (row m, term k) is `values[rows[m] + k step]`.
#[derive(Clone, Copy)]
pub(super) struct Left<'a> {
    pub values: &'a [f32],
    pub rows: &'a [usize],
    pub step: usize,
}

/// The right factor. Element (term k, column n) is `values[terms[k] + n]`.
#[derive(Clone, Copy)]
pub(super) struct Right<'a> {
    pub values: &'a [f32],
    pub terms: &'a [usize],
}

/// The initial value to which the product is added.
#[derive(Clone, Copy)]
pub(super) enum Onto<'a> {
    Nothing,
    /// The output itself.
    Output,
    /// A value for each column, the same in all rows.
    Columns(&'a [f32]),
    /// A value for each row, the same in all columns.
    Rows(&'a [f32]),
}

/// `left · right` with `columns` columns. The rows of `output` have the stride `stride`.
pub(super) fn multiply(
    left: Left<'_>,
    right: Right<'_>,
    onto: Onto<'_>,
    output: &mut [f32],
    columns: usize,
    stride: usize,
) {
    let (rows, depth) = (left.rows.len(), right.terms.len());
    if rows == 0 || columns == 0 {
        return;
    }
    if depth > 0 {
        let (mut row, mut term) = (0, 0);
        vectorized::furthest(left.rows, &mut row);
        vectorized::furthest(right.terms, &mut term);
        assert!(row + (depth - 1) * left.step < left.values.len());
        assert!(term + columns <= right.values.len());
    }
    assert!(columns <= stride && (rows - 1) * stride + columns <= output.len());
    match onto {
        Onto::Columns(numbers) => assert_eq!(numbers.len(), columns),
        Onto::Rows(numbers) => assert_eq!(numbers.len(), rows),
        Onto::Nothing | Onto::Output => {}
    }
    let product = Product { left, right, onto, output: output.as_mut_ptr(), columns, stride };
    // SAFETY: the processor has the instructions, and by the assertions above every element that
    // the sizes and offsets reach lies in its slice.
    unsafe {
        match detected() {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => avx512(&product),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => avx2(&product),
            _ => plain(&product),
        }
    }
}

/// Columns of the right factor that a tile reads, if there are as many.
pub(super) fn tile_columns() -> usize {
    match detected() {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512(_) => simd::F32x16::TILE_COLUMNS,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2(_) => simd::F32x8::TILE_COLUMNS,
        InstructionSet::Portable => Unfused::TILE_COLUMNS,
    }
}

/// Vectors with the sizes of their register tiles.
trait Tiled: Vector {
    /// Largest number of rows of a tile that is 1, 2, 3 or 4 vectors wide; 0 where there is none.
    /// The accumulators of a tile, one row of vectors and one broadcast number fit in the
    /// registers.
    const TILE_ROWS: [usize; 4];

    /// Columns of the widest tile.
    const TILE_COLUMNS: usize = {
        let mut widest = 4;
        while Self::TILE_ROWS[widest - 1] == 0 {
            widest -= 1;
        }
        widest * Self::LANES
    };
}

impl Tiled for Unfused {
    const TILE_ROWS: [usize; 4] = [6, 4, 0, 0];
}

#[cfg(target_arch = "x86_64")]
impl Tiled for simd::F32x8 {
    const TILE_ROWS: [usize; 4] = [8, 6, 0, 0];
}

#[cfg(target_arch = "x86_64")]
impl Tiled for simd::F32x16 {
    const TILE_ROWS: [usize; 4] = [12, 12, 8, 6];
}

struct Product<'a> {
    left: Left<'a>,
    right: Right<'a>,
    onto: Onto<'a>,
    output: *mut f32,
    columns: usize,
    stride: usize,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
unsafe fn avx512(product: &Product<'_>) {
    // SAFETY: see `multiply`.
    unsafe { product.all_columns::<simd::F32x16>() };
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn avx2(product: &Product<'_>) {
    // SAFETY: see `multiply`.
    unsafe { product.all_columns::<simd::F32x8>() };
}

#[inline(never)]
unsafe fn plain(product: &Product<'_>) {
    // SAFETY: see `multiply`.
    unsafe { product.all_columns::<Unfused>() };
}

// Everything below is unsafe for the same two reasons, which `multiply` has checked: it uses the
// vectors' instructions, and it reads and writes where the offsets point.
#[expect(
    clippy::needless_range_loop,
    reason = "loops over M and N are unrolled, so that sums stay in registers; iterators are not"
)]
impl Product<'_> {
    #[inline(always)]
    unsafe fn all_columns<V: Tiled>(&self) {
        let mut column = 0;
        while column < self.columns {
            let vectors = (self.columns - column).div_ceil(V::LANES);
            // SAFETY: the columns are the product's.
            column += V::LANES
                * unsafe {
                    if vectors >= 4 && V::TILE_ROWS[3] > 0 {
                        self.all_rows::<V, 4>(column)
                    } else if vectors >= 3 && V::TILE_ROWS[2] > 0 {
                        self.all_rows::<V, 3>(column)
                    } else if vectors >= 2 {
                        self.all_rows::<V, 2>(column)
                    } else {
                        self.all_rows::<V, 1>(column)
                    }
                };
        }
    }

    /// Computes `N` vectors of columns from `column` on, and gives `N`.
    #[inline(always)]
    unsafe fn all_rows<V: Tiled, const N: usize>(&self, column: usize) -> usize {
        let most = V::TILE_ROWS[N - 1];
        let rows = self.left.rows.len();
        let mut row = 0;
        while row < rows {
            let count = (rows - row).min(most);
            // SAFETY: the rows are the product's.
            row += unsafe {
                if most >= 12 && count >= 12 {
                    self.tile::<V, 12, N>(row, column)
                } else if most >= 8 && count >= 8 {
                    self.tile::<V, 8, N>(row, column)
                } else if most >= 6 && count >= 6 {
                    self.tile::<V, 6, N>(row, column)
                } else if count >= 4 {
                    self.tile::<V, 4, N>(row, column)
                } else if count >= 2 {
                    self.tile::<V, 2, N>(row, column)
                } else {
                    self.tile::<V, 1, N>(row, column)
                }
            };
        }
        N
    }

    /// Computes `M` rows of `N` vectors, and gives `M`. The last vector may reach beyond the
    /// columns.
    #[inline(always)]
    unsafe fn tile<V: Vector, const M: usize, const N: usize>(
        &self,
        row: usize,
        column: usize,
    ) -> usize {
        // SAFETY: see above.
        unsafe {
            if self.columns - column >= N * V::LANES {
                self.sum::<V, M, N, true>(row, column);
            } else {
                self.sum::<V, M, N, false>(row, column);
            }
        }
        M
    }

    /// Computes a tile, whole or cut. Whole tiles have no mask, because sixteen registers have no
    /// room for it.
    #[inline(always)]
    unsafe fn sum<V: Vector, const M: usize, const N: usize, const WHOLE: bool>(
        &self,
        row: usize,
        column: usize,
    ) {
        // SAFETY: see above.
        unsafe {
            let mask = V::mask(self.columns - column - (N - 1) * V::LANES);
            let output = self.output.add(row * self.stride + column);
            let mut lefts = [self.left.values.as_ptr(); M];
            for m in 0..M {
                lefts[m] = lefts[m].add(*self.left.rows.get_unchecked(row + m));
            }
            let right = self.right.values.as_ptr().add(column);

            let mut sums = [[V::splat(0.0); N]; M];
            match self.onto {
                Onto::Nothing => {}
                Onto::Output => {
                    for m in 0..M {
                        sums[m] = read::<V, N, WHOLE>(output.add(m * self.stride), mask);
                    }
                }
                Onto::Columns(numbers) => {
                    sums = [read::<V, N, WHOLE>(numbers.as_ptr().add(column), mask); M]
                }
                Onto::Rows(numbers) => {
                    for m in 0..M {
                        sums[m] = [V::splat(*numbers.get_unchecked(row + m)); N];
                    }
                }
            }
            let mut term = 0;
            for (index, terms) in self.right.terms.chunks(TERMS).enumerate() {
                if index > 0 {
                    sums = [[V::splat(0.0); N]; M];
                }
                for &offset in terms {
                    let values = read::<V, N, WHOLE>(right.add(offset), mask);
                    for m in 0..M {
                        let factor = V::splat(*lefts[m].add(term));
                        for n in 0..N {
                            sums[m][n] = values[n].mul_add(factor, sums[m][n]);
                        }
                    }
                    term += self.left.step;
                }
                if index > 0 {
                    for m in 0..M {
                        let before = read::<V, N, WHOLE>(output.add(m * self.stride), mask);
                        for n in 0..N {
                            sums[m][n] = before[n].add(sums[m][n]);
                        }
                    }
                }
                write::<V, M, N, WHOLE>(&sums, output, self.stride, mask);
            }
            if self.right.terms.is_empty() {
                write::<V, M, N, WHOLE>(&sums, output, self.stride, mask);
            }
        }
    }
}

#[inline(always)]
unsafe fn read<V: Vector, const N: usize, const WHOLE: bool>(
    from: *const f32,
    mask: V::Mask,
) -> [V; N] {
    // SAFETY: as in `Product::tile`.
    unsafe {
        let mut vectors = [V::splat(0.0); N];
        for (n, vector) in vectors.iter_mut().enumerate().take(N - 1) {
            *vector = V::load(from.add(n * V::LANES));
        }
        let last = from.add((N - 1) * V::LANES);
        vectors[N - 1] =
            if WHOLE { V::load(last) } else { V::load_masked(last, mask, vectors[N - 1]) };
        vectors
    }
}

#[inline(always)]
unsafe fn write<V: Vector, const M: usize, const N: usize, const WHOLE: bool>(
    sums: &[[V; N]; M],
    output: *mut f32,
    stride: usize,
    mask: V::Mask,
) {
    for (m, sums) in sums.iter().enumerate() {
        // SAFETY: as in `Product::tile`.
        unsafe {
            let row = output.add(m * stride);
            for (n, vector) in sums.iter().enumerate().take(N - 1) {
                vector.store(row.add(n * V::LANES));
            }
            let last = row.add((N - 1) * V::LANES);
            if WHOLE { sums[N - 1].store(last) } else { sums[N - 1].store_masked(last, mask) }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::{ProptestConfig, proptest};

    use super::super::instruction_set;
    use super::{Left, Onto, Right, multiply};

    const UNTOUCHED: f32 = 77.0;

    /// Compares each instruction set with sums in double precision.
    #[track_caller]
    fn check(rows: usize, columns: usize, depth: usize, step: usize, onto: usize) {
        let wave = |length: usize, rate: f32| -> Vec<f32> {
            (0..length).map(|index| (index as f32 * rate).sin()).collect()
        };
        // The rows overlap and are not in order.
        let left_rows: Vec<usize> = (0..rows).map(|row| row * 3 % rows.max(1) * 2).collect();
        let terms: Vec<usize> = (0..depth).map(|term| term * 7 % depth * 5).collect();
        let left = wave(2 * rows + depth * step, 0.7);
        let right = wave(5 * depth + columns, 1.1);
        let (of_rows, of_columns) = (wave(rows, 0.3), wave(columns, 0.4));
        let stride = columns + 3;
        let before = wave(rows * stride, 0.9);
        let onto = match onto {
            0 => Onto::Nothing,
            1 => Onto::Output,
            2 => Onto::Columns(&of_columns),
            _ => Onto::Rows(&of_rows),
        };
        instruction_set::tests::with_each(|set| {
            let mut output = before.clone();
            for row in output.chunks_mut(stride) {
                row[columns..].fill(UNTOUCHED);
            }
            let left_factor = Left { values: &left, rows: &left_rows, step };
            let right_factor = Right { values: &right, terms: &terms };
            multiply(left_factor, right_factor, onto, &mut output, columns, stride);
            for (m, (row, before)) in output.chunks(stride).zip(before.chunks(stride)).enumerate() {
                for (n, &found) in row[..columns].iter().enumerate() {
                    let start = match onto {
                        Onto::Nothing => 0.0,
                        Onto::Output => before[n],
                        Onto::Columns(numbers) => numbers[n],
                        Onto::Rows(numbers) => numbers[m],
                    };
                    let products = terms.iter().enumerate().map(|(k, &term)| {
                        f64::from(left[left_rows[m] + k * step]) * f64::from(right[term + n])
                    });
                    let (mut exact, mut magnitude) = (f64::from(start), 1.0);
                    for product in products {
                        exact += product;
                        magnitude += product.abs();
                    }
                    let error = (f64::from(found) - exact).abs() / magnitude;
                    assert!(error < 1e-6, "{set:?} element {m}, {n}: {found} for {exact}");
                }
                assert!(row[columns..].iter().all(|&value| value == UNTOUCHED), "{set:?}");
            }
        });
    }

    #[test]
    fn every_height_and_width_of_a_tile_gives_the_product() {
        for rows in 1..20 {
            for columns in [1, 3, 4, 8, 15, 16, 17, 31, 33, 48, 50, 64, 65, 130] {
                check(rows, columns, 5, 1, rows % 4);
            }
        }
    }

    #[test]
    fn sums_of_no_terms_are_what_they_are_added_to() {
        for onto in 0..4 {
            check(5, 20, 0, 1, onto);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn products_are_those_of_the_definition(
            rows in 1..30_usize,
            columns in 1..150_usize,
            depth in 1..300_usize,
            step in 1..4_usize,
            onto in 0..4_usize,
        ) {
            check(rows, columns, depth, step, onto);
        }
    }

    #[test]
    #[should_panic(expected = "assertion failed")]
    fn a_factor_that_ends_too_early_is_refused() {
        let left = Left { values: &[1.0; 7], rows: &[0, 4], step: 1 };
        let right = Right { values: &[1.0; 8], terms: &[0, 2, 4, 6] };
        multiply(left, right, Onto::Nothing, &mut [0.0; 4], 2, 2);
    }
}
