//! Factors of products, packed in the order in which they are read.

use std::cell::RefCell;

use rayon::prelude::*;

use super::factors::Factors;
use super::pairs::{Pair, across_rows, along_rows};
use super::product::{Element, Left, Number, Offsets, Onto, Right, multiply, tile_columns};
use super::transposition::transpose;

/// The widths of panels are a multiple of this, the width of the widest vectors.
const LANES: usize = 16;

/// The width of whole panels with AVX-512.
const WIDE: usize = 4 * LANES;

/// Elements below which a second thread does not pay.
const TASK: usize = 65_536;

/// Pairs between the rows of a packed left factor. With a stride of a power of two they would share
/// few sets of the first-level cache.
const APART: usize = 16;

/// The right factor of a product, packed so that a register tile reads consecutive memory: panels
/// of neighbouring columns, each row by row. A row has one term, or a pair of two.
#[derive(Debug)]
pub(super) struct Panels {
    numbers: Numbers,
    depth: usize,
    columns: usize,
    /// Columns of a panel.
    width: usize,
    /// Offsets of the rows of a panel.
    rows: Vec<usize>,
}

#[derive(Debug)]
enum Numbers {
    Singles(Vec<f32>),
    Pairs(Vec<Pair>),
}

impl Numbers {
    fn factors(&self) -> Factors {
        match self {
            Self::Singles(_) => Factors::F32,
            Self::Pairs(_) => Factors::Bf16,
        }
    }
}

impl Default for Panels {
    fn default() -> Self {
        Self::new(Factors::F32)
    }
}

thread_local! {
    /// The pairs of a left factor.
    static LEFT: RefCell<Vec<Pair>> = const { RefCell::new(Vec::new()) };
}

impl Panels {
    /// Panels of no columns.
    pub fn new(factors: Factors) -> Self {
        let numbers = match factors {
            Factors::F32 => Numbers::Singles(Vec::new()),
            Factors::Bf16 => Numbers::Pairs(Vec::new()),
        };
        Self { numbers, depth: 0, columns: 0, width: 0, rows: Vec::new() }
    }

    /// Empties this if it has other numbers.
    pub fn set_factors(&mut self, factors: Factors) {
        if self.numbers.factors() != factors {
            *self = Self::new(factors);
        }
    }

    /// Packs a matrix whose element (k, n) is `values[k row_stride + n]`.
    pub fn of_rows(
        factors: Factors,
        values: &[f32],
        extent: [usize; 2],
        row_stride: usize,
    ) -> Self {
        let mut panels = Self::new(factors);
        panels.write_rows(values, extent, row_stride);
        panels
    }

    /// Packs a matrix whose element (k, n) is `values[n row_stride + k]`.
    pub fn of_columns(
        factors: Factors,
        values: &[f32],
        extent: [usize; 2],
        row_stride: usize,
    ) -> Self {
        let mut panels = Self::new(factors);
        panels.write_columns(values, extent, row_stride);
        panels
    }

    /// Overwrites this with the result of [`Panels::of_rows`], in the same memory.
    pub fn write_rows(&mut self, values: &[f32], [depth, columns]: [usize; 2], row_stride: usize) {
        let (width, length) = self.resize([depth, columns]);
        match &mut self.numbers {
            Numbers::Singles(panels) => {
                for (index, panel) in panels.chunks_exact_mut(length).enumerate() {
                    let first = index * width;
                    let rows = values[first..].chunks(row_stride);
                    // A copy of a known length is compiled without a call.
                    match (width, width.min(columns - first)) {
                        (LANES, LANES) => copy_rows::<LANES>(panel, rows),
                        (WIDE, WIDE) => copy_rows::<WIDE>(panel, rows),
                        (width, seen) => {
                            for (row, from) in panel.chunks_exact_mut(width).zip(rows) {
                                row[..seen].copy_from_slice(&from[..seen]);
                            }
                        }
                    }
                }
            }
            Numbers::Pairs(panels) => {
                for (index, panel) in panels.chunks_exact_mut(length).enumerate() {
                    let first = index * width;
                    let extent = [depth, width.min(columns - first)];
                    across_rows(&values[first..], row_stride, extent, panel, width);
                }
            }
        }
    }

    /// Overwrites this with the result of [`Panels::of_columns`], in the same memory.
    pub fn write_columns(
        &mut self,
        values: &[f32],
        [depth, columns]: [usize; 2],
        row_stride: usize,
    ) {
        let (width, length) = self.resize([depth, columns]);
        let (tasks, parts) = (TASK.div_ceil(length), values.par_chunks(width * row_stride));
        let columns_of = |part: &[f32]| width.min(part.len().div_ceil(row_stride));
        match &mut self.numbers {
            Numbers::Singles(panels) => {
                let panels = panels.par_chunks_exact_mut(length).with_min_len(tasks);
                panels.zip(parts).for_each(|(panel, part)| {
                    transpose(part, [columns_of(part), depth], row_stride, panel, width);
                });
            }
            Numbers::Pairs(panels) => {
                let pairs = depth.div_ceil(2);
                let panels = panels.par_chunks_exact_mut(length).with_min_len(tasks);
                panels.zip(parts).for_each_init(Vec::new, |rounded, (panel, part)| {
                    let count = columns_of(part);
                    rounded.resize(count * pairs, Pair::default());
                    along_rows(part, &multiples(count, row_stride), depth, rounded, pairs);
                    let (from, to) = (Pair::as_floats(rounded), Pair::as_floats_mut(panel));
                    transpose(from, [count, pairs], pairs, to, width);
                });
            }
        }
    }

    /// Sets the size and gives the width and the length of a panel. The width is that of a register
    /// tile, if the matrix is wide enough. In a wider panel the rows of a tile would share few sets
    /// of the first-level cache.
    fn resize(&mut self, [depth, columns]: [usize; 2]) -> (usize, usize) {
        let rows = match self.numbers {
            Numbers::Singles(_) => depth,
            Numbers::Pairs(_) => depth.div_ceil(2),
        };
        let width = tile_columns().next_multiple_of(LANES).min(columns.next_multiple_of(LANES));
        if (self.rows.len(), self.width) != (rows, width) {
            self.rows.clear();
            self.rows.extend((0..rows).map(|row| row * width));
        }
        (self.depth, self.columns, self.width) = (depth, columns, width);
        let length = columns.div_ceil(width) * rows * width;
        match &mut self.numbers {
            Numbers::Singles(values) => values.resize(length, 0.0),
            Numbers::Pairs(values) => values.resize(length, Pair::default()),
        }
        (width, rows * width)
    }

    /// The product of `left` with the first `depth` rows and `columns` columns of this. The rows of
    /// `output` have the stride `stride`. With bf16, the step of `left` is 1, or its rows are
    /// neighbours.
    pub fn multiply_part<E: Element>(
        &self,
        left: Left<'_>,
        [depth, columns]: [usize; 2],
        onto: Onto<'_>,
        output: &mut [E],
        stride: usize,
    ) {
        let columns = columns.min(self.columns);
        match &self.numbers {
            Numbers::Singles(values) => {
                self.multiply_panels(values, left, [depth, columns], onto, output, stride);
            }
            Numbers::Pairs(values) => LEFT.with_borrow_mut(|pairs| {
                let extent = [depth.div_ceil(2), columns];
                let (each, count) = (left.rows.each(), left.rows.count());
                let rows;
                let left = if left.step == 1 {
                    let apart = extent[0] + APART;
                    pairs.resize(pairs.len().max(count * apart), Pair::default());
                    along_rows(left.values, each, depth, pairs, apart);
                    rows = multiples(count, apart);
                    Left { values: &pairs[..], rows: Offsets::of(&rows), step: 1 }
                } else {
                    let first = each.first().copied().unwrap_or(0);
                    assert!(each.iter().zip(first..).all(|(&row, neighbour)| row == neighbour));
                    let apart = count + APART;
                    pairs.resize(pairs.len().max(extent[0] * apart), Pair::default());
                    across_rows(&left.values[first..], left.step, [depth, count], pairs, apart);
                    rows = multiples(count, 1);
                    Left { values: &pairs[..], rows: Offsets::of(&rows), step: apart }
                };
                self.multiply_panels(values, left, extent, onto, output, stride);
            }),
        }
    }

    fn multiply_panels<N: Number, E: Element>(
        &self,
        values: &[N],
        left: Left<'_, N>,
        [rows, columns]: [usize; 2],
        onto: Onto<'_>,
        output: &mut [E],
        stride: usize,
    ) {
        let length = self.rows.len() * self.width;
        let terms = Offsets::of(&self.rows[..rows]);
        for first in (0..columns).step_by(self.width) {
            let columns = self.width.min(columns - first);
            let values = &values[first / self.width * length..][..length];
            let right = Right { values, terms };
            let onto = match onto {
                Onto::Columns(numbers) => Onto::Columns(&numbers[first..first + columns]),
                other => other,
            };
            multiply(left, right, onto, &mut output[first..], columns, stride);
        }
    }

    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The product of `left` with this. [`Panels::multiply_part`] says what `left` may be.
    pub fn multiply<E: Element>(
        &self,
        left: Left<'_>,
        onto: Onto<'_>,
        output: &mut [E],
        stride: usize,
    ) {
        self.multiply_part(left, [self.depth, self.columns], onto, output, stride);
    }
}

/// Where rows begin that are `stride` apart.
pub(super) fn multiples(count: usize, stride: usize) -> Vec<usize> {
    (0..count).map(|row| row * stride).collect()
}

/// Copies the first `N` elements of each row.
fn copy_rows<'a, const N: usize>(panel: &mut [f32], rows: impl Iterator<Item = &'a [f32]>) {
    let (places, _) = panel.as_chunks_mut::<N>();
    for (place, row) in places.iter_mut().zip(rows) {
        if let Some(row) = row.first_chunk::<N>() {
            *place = *row;
        }
    }
}
