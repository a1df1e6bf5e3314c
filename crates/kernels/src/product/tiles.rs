//! A product in register tiles.

use simd::Vector;

use super::arithmetic::Arithmetic;
use super::{Number, Onto, Product};

/// Numbers of a row that are summed in registers before they are added to the output. A sum of sums
/// has smaller rounding errors than a long sum, and norms of few samples magnify rounding errors.
const TERMS: usize = 128;

// Everything here is unsafe for the same two reasons, which `multiply` has checked: it uses the
// vectors' instructions, and it reads and writes where the offsets point.
#[expect(
    clippy::needless_range_loop,
    reason = "loops over M and W are unrolled, so that sums stay in registers; iterators are not"
)]
impl<N: Number> Product<'_, N> {
    #[inline(always)]
    pub(super) unsafe fn all_columns<V: Vector, A: Arithmetic<V, Number = N>>(&self) {
        let mut column = 0;
        while column < self.columns {
            let vectors = (self.columns - column).div_ceil(V::LANES);
            // SAFETY: the columns are the product's.
            column += V::LANES
                * unsafe {
                    if vectors >= 4 && A::TILE_ROWS[3] > 0 {
                        self.all_rows::<V, A, 4>(column)
                    } else if vectors >= 3 && A::TILE_ROWS[2] > 0 {
                        self.all_rows::<V, A, 3>(column)
                    } else if vectors >= 2 {
                        self.all_rows::<V, A, 2>(column)
                    } else {
                        self.all_rows::<V, A, 1>(column)
                    }
                };
        }
    }

    /// Computes `W` vectors of columns from `column` on, and gives `W`.
    #[inline(always)]
    unsafe fn all_rows<V: Vector, A: Arithmetic<V, Number = N>, const W: usize>(
        &self,
        column: usize,
    ) -> usize {
        let most = A::TILE_ROWS[W - 1];
        let rows = self.left.rows.count();
        let mut row = 0;
        while row < rows {
            let rest = rows - row;
            // Two tiles of four rows are faster than one of six and one of two, whose few sums wait
            // for each other.
            let count = if most == 6 && (rest == 8 || rest == 9) { 4 } else { rest.min(most) };
            // SAFETY: the rows are the product's.
            row += unsafe {
                if most >= 12 && count >= 12 {
                    self.tile::<V, A, 12, W>(row, column)
                } else if most >= 8 && count >= 8 {
                    self.tile::<V, A, 8, W>(row, column)
                } else if most >= 6 && count >= 6 {
                    self.tile::<V, A, 6, W>(row, column)
                } else if count >= 4 {
                    self.tile::<V, A, 4, W>(row, column)
                } else if count >= 2 {
                    self.tile::<V, A, 2, W>(row, column)
                } else {
                    self.tile::<V, A, 1, W>(row, column)
                }
            };
        }
        W
    }

    /// Computes `M` rows of `W` vectors, and gives `M`. The last vector may reach beyond the
    /// columns.
    #[inline(always)]
    unsafe fn tile<V: Vector, A: Arithmetic<V, Number = N>, const M: usize, const W: usize>(
        &self,
        row: usize,
        column: usize,
    ) -> usize {
        // SAFETY: see above.
        unsafe {
            if self.columns - column >= W * V::LANES {
                self.sum::<V, A, M, W, true>(row, column);
            } else {
                self.sum::<V, A, M, W, false>(row, column);
            }
        }
        M
    }

    /// Computes a tile, whole or cut. Whole tiles have no mask, because sixteen registers have no
    /// room for it.
    #[inline(always)]
    unsafe fn sum<
        V: Vector,
        A: Arithmetic<V, Number = N>,
        const M: usize,
        const W: usize,
        const WHOLE: bool,
    >(
        &self,
        row: usize,
        column: usize,
    ) {
        // SAFETY: see above.
        unsafe {
            let mask = V::mask(self.columns - column - (W - 1) * V::LANES);
            let output = self.output.add(row * self.stride + column);
            let mut lefts = [self.left.values.as_ptr().cast::<f32>(); M];
            for m in 0..M {
                lefts[m] = lefts[m].add(*self.left.rows.each.get_unchecked(row + m));
            }
            let right = self.right.values.as_ptr().cast::<f32>().add(column);

            let mut sums = [[V::splat(0.0); W]; M];
            match self.onto {
                Onto::Nothing => {}
                Onto::Output => {
                    for m in 0..M {
                        sums[m] = read::<V, W, WHOLE>(output.add(m * self.stride), mask);
                    }
                }
                Onto::Columns(numbers) => {
                    sums = [read::<V, W, WHOLE>(numbers.as_ptr().add(column), mask); M]
                }
                Onto::Rows(numbers) => {
                    for m in 0..M {
                        sums[m] = [V::splat(*numbers.get_unchecked(row + m)); W];
                    }
                }
            }
            let mut term = 0;
            for (index, terms) in self.right.terms.each.chunks(TERMS).enumerate() {
                if index > 0 {
                    sums = [[V::splat(0.0); W]; M];
                }
                for &offset in terms {
                    let row = read::<V, W, WHOLE>(right.add(offset), mask);
                    let mut values = [A::values(row[0]); W];
                    for n in 1..W {
                        values[n] = A::values(row[n]);
                    }
                    for m in 0..M {
                        let factor = A::values(V::splat(*lefts[m].add(term)));
                        for n in 0..W {
                            sums[m][n] = A::mul_add(values[n], factor, sums[m][n]);
                        }
                    }
                    term += self.left.step;
                }
                if index > 0 {
                    for m in 0..M {
                        let before = read::<V, W, WHOLE>(output.add(m * self.stride), mask);
                        for n in 0..W {
                            sums[m][n] = before[n].add(sums[m][n]);
                        }
                    }
                }
                write::<V, M, W, WHOLE>(&sums, output, self.stride, mask);
            }
            if self.right.terms.each.is_empty() {
                write::<V, M, W, WHOLE>(&sums, output, self.stride, mask);
            }
        }
    }
}

#[inline(always)]
unsafe fn read<V: Vector, const W: usize, const WHOLE: bool>(
    from: *const f32,
    mask: V::Mask,
) -> [V; W] {
    // SAFETY: as in `Product::tile`.
    unsafe {
        let mut vectors = [V::splat(0.0); W];
        for (n, vector) in vectors.iter_mut().enumerate().take(W - 1) {
            *vector = V::load(from.add(n * V::LANES));
        }
        let last = from.add((W - 1) * V::LANES);
        vectors[W - 1] =
            if WHOLE { V::load(last) } else { V::load_masked(last, mask, vectors[W - 1]) };
        vectors
    }
}

#[inline(always)]
unsafe fn write<V: Vector, const M: usize, const W: usize, const WHOLE: bool>(
    sums: &[[V; W]; M],
    output: *mut f32,
    stride: usize,
    mask: V::Mask,
) {
    for (m, sums) in sums.iter().enumerate() {
        // SAFETY: as in `Product::tile`.
        unsafe {
            let row = output.add(m * stride);
            for (n, vector) in sums.iter().enumerate().take(W - 1) {
                vector.store(row.add(n * V::LANES));
            }
            let last = row.add((W - 1) * V::LANES);
            if WHOLE { sums[W - 1].store(last) } else { sums[W - 1].store_masked(last, mask) }
        }
    }
}
