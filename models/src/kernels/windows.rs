use rayon::prelude::*;

use super::matrix::Matrix;

/// The windows that a kernel sees of a series `[channel, sample]`, as a matrix with a row for each
/// channel and tap t, whose element j is sample `first + step j + t`, or 0 beyond the ends.
#[derive(Clone, Copy)]
pub(super) struct Windows {
    pub channels: usize,
    /// Of the series.
    pub samples: usize,
    pub taps: usize,
    pub first: isize,
    pub step: usize,
    /// Windows.
    pub count: usize,
}

impl Windows {
    pub fn rows(&self) -> usize {
        self.channels * self.taps
    }

    /// `count` windows from number `from` on. Where these are no other numbers than the series'
    /// own, they are not copied to `scratch`.
    pub fn matrix<'a>(
        &self,
        series: &'a [f32],
        from: usize,
        count: usize,
        scratch: &'a mut Vec<f32>,
    ) -> Matrix<'a> {
        let inside = from + count <= self.samples;
        if self.taps == 1 && self.first == 0 && self.step == 1 && inside {
            return Matrix::new(&series[from..], self.channels, count, self.samples);
        }
        scratch.resize(self.rows() * count, 0.0);
        self.write(series, from, scratch, count);
        Matrix::new(scratch, self.rows(), count, count)
    }

    /// All windows, into rows that begin `row_stride` apart.
    pub fn write_all(&self, series: &[f32], into: &mut [f32], row_stride: usize) {
        for (rows, series) in
            into.chunks_mut(self.taps * row_stride).zip(series.chunks_exact(self.samples))
        {
            for (tap, row) in rows.chunks_mut(row_stride).enumerate() {
                self.write_row(series, tap, 0, &mut row[..self.count]);
            }
        }
    }

    fn write(&self, series: &[f32], from: usize, into: &mut [f32], count: usize) {
        into.par_chunks_exact_mut(self.taps * count)
            .zip(series.par_chunks_exact(self.samples))
            .with_min_len(TASK.div_ceil(self.taps * count))
            .for_each(|(rows, series)| {
                for (tap, row) in rows.chunks_exact_mut(count).enumerate() {
                    self.write_row(series, tap, from, row);
                }
            });
    }

    fn write_row(&self, series: &[f32], tap: usize, from: usize, row: &mut [f32]) {
        let offset = self.first + (from * self.step + tap).cast_signed();
        let before = if offset < 0 { offset.unsigned_abs().div_ceil(self.step) } else { 0 };
        let before = before.min(row.len());
        // Of the first window that begins inside the series.
        let start = (offset + (before * self.step).cast_signed()).unsigned_abs();
        let inside = self.samples.saturating_sub(start).div_ceil(self.step);
        let (zeros, rest) = row.split_at_mut(before);
        let (inside, after) = rest.split_at_mut(inside.min(rest.len()));
        zeros.fill(0.0);
        after.fill(0.0);
        if self.step == 1 {
            inside.copy_from_slice(&series[start.min(self.samples)..][..inside.len()]);
        } else {
            let seen = series.iter().skip(start).step_by(self.step);
            for (value, &seen) in inside.iter_mut().zip(seen) {
                *value = seen;
            }
        }
    }
}

/// Elements below which another thread is not worth waking.
const TASK: usize = 65_536;
