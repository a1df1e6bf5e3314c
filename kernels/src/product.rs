//! Matrix products in the calling thread. Linear maps, attention and convolutions use them.
//!
//! The accumulators of a register tile stay in registers. For each term, the tile loads one row of
//! the right factor as vectors, and broadcasts a column of the left factor number by number. Rows
//! of either factor may begin anywhere, so that a matrix of overlapping windows need not be written
//! out.
//!
//! A factor consists of f32, or of pairs of two terms as bf16. Processors with AVX-512 BF16 multiply
//! two pairs and add both products in one instruction. On others, pairs are extended to f32.

use simd::{InstructionSet, Unfused, Vector};

use super::instruction_set::detected;
use super::pairs::Pair;
use super::vectorized;

/// Numbers of a row that are summed in registers before they are added to the output. A sum of sums has
/// smaller rounding errors than a long sum, and norms of few samples magnify rounding errors.
const TERMS: usize = 128;

/// The left factor. Element (row m, term k) is `values[rows[m] + k step]`.
#[derive(Clone, Copy)]
pub(super) struct Left<'a, N = f32> {
    pub values: &'a [N],
    pub rows: &'a [usize],
    pub step: usize,
}

/// The right factor. Element (term k, column n) is `values[terms[k] + n]`.
#[derive(Clone, Copy)]
pub(super) struct Right<'a, N = f32> {
    pub values: &'a [N],
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
pub(super) fn multiply<N: Number>(
    left: Left<'_, N>,
    right: Right<'_, N>,
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
    unsafe { N::compute(&product, detected()) };
}

/// A number of a factor in memory. It has the 32 bits of an f32.
pub(super) trait Number: Copy + Sized {
    /// Columns of the right factor that a tile reads, if there are as many.
    fn tile_columns(set: InstructionSet) -> usize;

    /// # Safety
    /// The processor must have the instructions, and every element that the sizes and offsets reach
    /// must lie in its slice.
    unsafe fn compute(product: &Product<'_, Self>, set: InstructionSet);
}

impl Number for f32 {
    fn tile_columns(set: InstructionSet) -> usize {
        match set {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => widest::<simd::F32x16, Singles>(),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => widest::<simd::F32x8, Singles>(),
            InstructionSet::Portable => widest::<Unfused, Singles>(),
        }
    }

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
    fn tile_columns(set: InstructionSet) -> usize {
        match set {
            #[cfg(target_arch = "x86_64")]
            set if set.multiplies_bf16() => widest::<simd::F32x16, Pairs>(),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => widest::<simd::F32x16, ExtendedPairs>(),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => widest::<simd::F32x8, ExtendedPairs>(),
            InstructionSet::Portable => widest::<Unfused, ExtendedPairs>(),
        }
    }

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

/// The arithmetic on factors with vectors `V`.
trait Arithmetic<V: Vector> {
    type Number: Number;

    /// A vector of the right factor, or one number of the left factor in every lane.
    type Values: Copy;

    /// Largest number of rows of a tile that is 1, 2, 3 or 4 vectors wide; 0 where there is none.
    /// The accumulators of a tile, one row of vectors and one broadcast number fit in the
    /// registers.
    const TILE_ROWS: [usize; 4];

    /// # Safety
    /// The processor must have the instructions.
    unsafe fn values(vector: V) -> Self::Values;

    /// # Safety
    /// The processor must have the instructions.
    unsafe fn mul_add(values: Self::Values, factor: Self::Values, sum: V) -> V;
}

/// Columns of the widest tile.
const fn widest<V: Vector, A: Arithmetic<V>>() -> usize {
    let mut widest = 4;
    while A::TILE_ROWS[widest - 1] == 0 {
        widest -= 1;
    }
    widest * V::LANES
}

/// Factors of f32.
struct Singles;

macro_rules! singles {
    ($vector:ty, $tile_rows:expr) => {
        impl Arithmetic<$vector> for Singles {
            type Number = f32;
            type Values = $vector;
            const TILE_ROWS: [usize; 4] = $tile_rows;

            #[inline(always)]
            unsafe fn values(vector: $vector) -> $vector {
                vector
            }

            #[inline(always)]
            unsafe fn mul_add(values: $vector, factor: $vector, sum: $vector) -> $vector {
                // SAFETY: the caller guarantees the instructions.
                unsafe { Vector::mul_add(values, factor, sum) }
            }
        }
    };
}

singles!(Unfused, [6, 4, 0, 0]);
#[cfg(target_arch = "x86_64")]
singles!(simd::F32x8, [8, 6, 0, 0]);
#[cfg(target_arch = "x86_64")]
singles!(simd::F32x16, [12, 12, 8, 6]);

/// Factors of pairs, which the processor multiplies.
#[cfg(target_arch = "x86_64")]
struct Pairs;

#[cfg(target_arch = "x86_64")]
impl Arithmetic<simd::F32x16> for Pairs {
    type Number = Pair;
    type Values = simd::F32x16;
    const TILE_ROWS: [usize; 4] = [12, 12, 8, 6];

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
struct ExtendedPairs;

macro_rules! extended_pairs {
    ($vector:ty, $tile_rows:expr) => {
        impl Arithmetic<$vector> for ExtendedPairs {
            type Number = Pair;
            type Values = [$vector; 2];
            const TILE_ROWS: [usize; 4] = $tile_rows;

            #[inline(always)]
            unsafe fn values(vector: $vector) -> [$vector; 2] {
                // SAFETY: the caller guarantees the instructions.
                unsafe { vector.halves() }
            }

            #[inline(always)]
            unsafe fn mul_add(values: [$vector; 2], factor: [$vector; 2], sum: $vector) -> $vector {
                // SAFETY: the caller guarantees the instructions.
                unsafe {
                    let sum = Vector::mul_add(values[1], factor[1], sum);
                    Vector::mul_add(values[0], factor[0], sum)
                }
            }
        }
    };
}

extended_pairs!(Unfused, [4, 2, 0, 0]);
#[cfg(target_arch = "x86_64")]
extended_pairs!(simd::F32x8, [8, 4, 0, 0]);
#[cfg(target_arch = "x86_64")]
extended_pairs!(simd::F32x16, [12, 12, 6, 4]);

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

// Everything below is unsafe for the same two reasons, which `multiply` has checked: it uses the
// vectors' instructions, and it reads and writes where the offsets point.
#[expect(
    clippy::needless_range_loop,
    reason = "loops over M and N are unrolled, so that sums stay in registers; iterators are not"
)]
impl<N: Number> Product<'_, N> {
    #[inline(always)]
    unsafe fn all_columns<V: Vector, A: Arithmetic<V, Number = N>>(&self) {
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
        let rows = self.left.rows.len();
        let mut row = 0;
        while row < rows {
            let count = (rows - row).min(most);
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
                lefts[m] = lefts[m].add(*self.left.rows.get_unchecked(row + m));
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
            for (index, terms) in self.right.terms.chunks(TERMS).enumerate() {
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
            if self.right.terms.is_empty() {
                write::<V, M, W, WHOLE>(&sums, output, self.stride, mask);
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
    use super::super::panels::multiples;
    use super::*;

    const UNTOUCHED: f32 = 77.0;

    trait Wave: Number {
        /// The number at the place `index` of a wave.
        fn at(index: usize, rate: f32) -> Self;

        /// The products of the terms of both, in double precision.
        fn products(self, other: Self) -> [f64; 2];
    }

    impl Wave for f32 {
        fn at(index: usize, rate: f32) -> Self {
            (index as f32 * rate).sin()
        }

        fn products(self, other: Self) -> [f64; 2] {
            [f64::from(self) * f64::from(other), 0.0]
        }
    }

    impl Wave for Pair {
        fn at(index: usize, rate: f32) -> Self {
            Self::of(f32::at(index, rate), f32::at(index, 1.3 * rate))
        }

        fn products(self, other: Self) -> [f64; 2] {
            let ([a, b], [c, d]) = (self.halves(), other.halves());
            [f64::from(a) * f64::from(c), f64::from(b) * f64::from(d)]
        }
    }

    fn wave<N: Wave>(length: usize, rate: f32) -> Vec<N> {
        (0..length).map(|index| N::at(index, rate)).collect()
    }

    /// Compares each instruction set, and both kinds of numbers, with sums in double precision.
    #[track_caller]
    fn check(rows: usize, columns: usize, depth: usize, step: usize, onto: usize) {
        check_numbers::<f32>(rows, columns, depth, step, onto);
        check_numbers::<Pair>(rows, columns, depth, step, onto);
    }

    #[track_caller]
    fn check_numbers<N: Wave>(rows: usize, columns: usize, depth: usize, step: usize, onto: usize) {
        // The rows overlap and are not in order.
        let left_rows: Vec<usize> = (0..rows).map(|row| row * 3 % rows.max(1) * 2).collect();
        let terms: Vec<usize> = (0..depth).map(|term| term * 7 % depth * 5).collect();
        let left: Vec<N> = wave(2 * rows + depth * step, 0.7);
        let right: Vec<N> = wave(5 * depth + columns, 1.1);
        let (of_rows, of_columns): (Vec<f32>, Vec<f32>) = (wave(rows, 0.3), wave(columns, 0.4));
        let stride = columns + 3;
        let before: Vec<f32> = wave(rows * stride, 0.9);
        let onto = match onto {
            0 => Onto::Nothing,
            1 => Onto::Output,
            2 => Onto::Columns(&of_columns),
            _ => Onto::Rows(&of_rows),
        };
        let left_factor = Left { values: &left, rows: &left_rows, step };
        let right_factor = Right { values: &right, terms: &terms };
        instruction_set::tests::with_each(|set| {
            let mut output = before.clone();
            for row in output.chunks_mut(stride) {
                row[columns..].fill(UNTOUCHED);
            }
            multiply(left_factor, right_factor, onto, &mut output, columns, stride);
            for (m, (row, before)) in output.chunks(stride).zip(before.chunks(stride)).enumerate() {
                for (n, &found) in row[..columns].iter().enumerate() {
                    let start = match onto {
                        Onto::Nothing => 0.0,
                        Onto::Output => before[n],
                        Onto::Columns(numbers) => numbers[n],
                        Onto::Rows(numbers) => numbers[m],
                    };
                    let products = terms.iter().enumerate().flat_map(|(k, &term)| {
                        left[left_rows[m] + k * step].products(right[term + n])
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

    /// The tests above use AVX-512 BF16 where the processor has it.
    #[cfg(target_arch = "x86_64")]
    #[test]
    fn avx512_without_bf16_extends_pairs() {
        let InstructionSet::Avx512(_) = InstructionSet::best() else { return };
        let (rows, columns, depth) = (29, 150, 40);
        let (left, right): (Vec<Pair>, Vec<Pair>) =
            (wave(rows * depth, 0.7), wave(depth * columns, 1.1));
        let (left_rows, terms) = (multiples(rows, depth), multiples(depth, columns));
        let mut found = vec![UNTOUCHED; rows * columns];
        let product = Product {
            left: Left { values: &left, rows: &left_rows, step: 1 },
            right: Right { values: &right, terms: &terms },
            onto: Onto::Nothing,
            output: found.as_mut_ptr(),
            columns,
            stride: columns,
        };
        // SAFETY: the processor has the instructions, and the sizes are those of the slices.
        unsafe { avx512::<ExtendedPairs>(&product) };
        for (index, found) in found.into_iter().enumerate() {
            let (m, n) = (index / columns, index % columns);
            let products =
                (0..depth).flat_map(|k| left[m * depth + k].products(right[k * columns + n]));
            let exact: f64 = products.sum();
            assert!((f64::from(found) - exact).abs() < 1e-4, "{m}, {n}: {found} for {exact}");
        }
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
