use rayon::prelude::*;

use super::product::{Left, Onto, Right, multiply, tile_columns};
use super::transposition::transpose;

/// The widths of panels are a multiple of this, the width of the widest vectors.
const LANES: usize = 16;

/// Elements below which a second thread does not pay.
const TASK: usize = 65_536;

/// The right factor of a product, packed so that a register tile reads consecutive memory: panels
/// of neighbouring columns, each row by row.
#[derive(Debug, Default)]
pub(super) struct Panels {
    values: Vec<f32>,
    columns: usize,
    /// Columns of a panel.
    width: usize,
    /// Offsets of the rows of a panel.
    terms: Vec<usize>,
}

impl Panels {
    /// Packs a matrix whose element (k, n) is `values[k row_stride + n]`.
    pub fn of_rows(values: &[f32], depth: usize, columns: usize, row_stride: usize) -> Self {
        let mut panels = Self::default();
        panels.write_rows(values, depth, columns, row_stride);
        panels
    }

    /// Packs a matrix whose element (k, n) is `values[n row_stride + k]`.
    pub fn of_columns(values: &[f32], depth: usize, columns: usize, row_stride: usize) -> Self {
        let mut panels = Self::default();
        panels.write_columns(values, depth, columns, row_stride);
        panels
    }

    /// Overwrites this with the result of [`Panels::of_rows`], in the same memory.
    pub fn write_rows(&mut self, values: &[f32], depth: usize, columns: usize, row_stride: usize) {
        let width = self.resize(depth, columns);
        for (index, panel) in self.values.chunks_exact_mut(depth * width).enumerate() {
            let first = index * width;
            let rows = values[first..].chunks(row_stride);
            // A copy of a known length is compiled without a call.
            match width.min(columns - first) {
                LANES if width == LANES => copy_rows::<LANES>(panel, rows),
                seen => {
                    for (row, from) in panel.chunks_exact_mut(width).zip(rows) {
                        row[..seen].copy_from_slice(&from[..seen]);
                    }
                }
            }
        }
    }

    /// Overwrites this with the result of [`Panels::of_columns`], in the same memory.
    pub fn write_columns(
        &mut self,
        values: &[f32],
        depth: usize,
        columns: usize,
        row_stride: usize,
    ) {
        let width = self.resize(depth, columns);
        self.values
            .par_chunks_exact_mut(depth * width)
            .with_min_len(TASK.div_ceil(depth * width))
            .zip(values.par_chunks(width * row_stride))
            .for_each(|(panel, rows)| {
                let count = width.min(rows.len().div_ceil(row_stride));
                transpose(rows, [count, depth], row_stride, panel, width);
            });
    }

    /// Sets the size and gives the width of a panel: that of a register tile, if the matrix is wide
    /// enough. In a wider panel the rows of a tile would share few sets of the first-level cache.
    fn resize(&mut self, depth: usize, columns: usize) -> usize {
        let width = tile_columns().next_multiple_of(LANES).min(columns.next_multiple_of(LANES));
        if (self.terms.len(), self.width) != (depth, width) {
            self.terms.clear();
            self.terms.extend((0..depth).map(|term| term * width));
        }
        (self.columns, self.width) = (columns, width);
        self.values.resize(columns.div_ceil(width) * depth * width, 0.0);
        width
    }

    /// The product of `left` with the first `depth` rows and `columns` columns of this. The rows of
    /// `output` have the stride `stride`.
    pub fn multiply_part(
        &self,
        left: Left<'_>,
        [depth, columns]: [usize; 2],
        onto: Onto<'_>,
        output: &mut [f32],
        stride: usize,
    ) {
        let length = self.terms.len() * self.width;
        for first in (0..columns.min(self.columns)).step_by(self.width) {
            let columns = self.width.min(columns - first);
            let values = &self.values[first / self.width * length..][..length];
            let right = Right { values, terms: &self.terms[..depth] };
            let onto = match onto {
                Onto::Columns(numbers) => Onto::Columns(&numbers[first..first + columns]),
                other => other,
            };
            multiply(left, right, onto, &mut output[first..], columns, stride);
        }
    }

    /// The product of `left` with this. The rows of `output` have the stride `stride`.
    pub fn multiply(&self, left: Left<'_>, onto: Onto<'_>, output: &mut [f32], stride: usize) {
        self.multiply_part(left, [self.terms.len(), self.columns], onto, output, stride);
    }
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
