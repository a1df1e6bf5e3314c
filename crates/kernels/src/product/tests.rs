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
    let left_factor = Left { values: &left, rows: Offsets::of(&left_rows), step };
    let right_factor = Right { values: &right, terms: Offsets::of(&terms) };
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
                let products = terms
                    .iter()
                    .enumerate()
                    .flat_map(|(k, &term)| left[left_rows[m] + k * step].products(right[term + n]));
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
        left: Left { values: &left, rows: Offsets::of(&left_rows), step: 1 },
        right: Right { values: &right, terms: Offsets::of(&terms) },
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
    let left = Left { values: &[1.0; 7], rows: Offsets::of(&[0, 4]), step: 1 };
    let right = Right { values: &[1.0; 8], terms: Offsets::of(&[0, 2, 4, 6]) };
    multiply(left, right, Onto::Nothing, &mut [0.0; 4], 2, 2);
}

#[test]
#[should_panic(expected = "IS_NUMBER")]
fn nothing_is_added_to_memory_without_numbers() {
    let left = Left { values: &[1.0], rows: Offsets::of(&[0]), step: 1 };
    let right = Right { values: &[1.0], terms: Offsets::of(&[0]) };
    multiply(left, right, Onto::Output, &mut [MaybeUninit::uninit()], 1, 1);
}
