//! Cross-correlation along the last dimension, its adjoint and the gradient of its kernel: one's
//! derivative is made of the others, and so is that of the transposed convolution.
//!
//! Each is a product of matrices with the windows that a kernel sees, which are written out for one
//! trajectory at a time, a cacheful at most.

use rayon::prelude::*;

use super::matrix::{Matrix, Output, multiply};
use super::vectorized;
use super::windows::Windows;

/// Elements of a task's windows: 1 MiB, of the order of a core's second-level cache.
const CACHEFUL: usize = 262_144;

/// Windows that are multiplied at once; fewer keep a core from its full speed.
const FEWEST_WINDOWS: usize = 64;

/// Samples that the kernel's gradient sums over in one product. Series that are shorter are put one
/// behind the other, or else reading and writing the sums would take longer than the products.
const DEPTH: usize = 512;

/// Terms that are added up before they are added to the rest. Group norms of few samples magnify the
/// rounding of what they are given, and a sum of sums is rounded less than a long sum.
const TERMS: usize = 64;

/// A correlation of fine series `[batch, fine channel, fine sample]` with a kernel
/// `[coarse channel, fine channel, kernel]`, zeros beyond the ends, to coarse series
/// `[batch, coarse channel, coarse sample]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Correlation {
    pub fine_channels: usize,
    pub fine_samples: usize,
    pub coarse_channels: usize,
    pub coarse_samples: usize,
    pub kernel: usize,
    pub stride: usize,
    pub padding: usize,
}

impl Correlation {
    /// coarse`[o, j]` = bias`[o]` + Σ kernel`[o, i, k]` fine`[i, stride j + k - padding]`.
    pub fn forward(&self, fine: &[f32], kernel: &[f32], bias: Option<&[f32]>) -> Vec<f32> {
        let of_fine = self.fine_channels * self.fine_samples;
        let of_coarse = self.coarse_channels * self.coarse_samples;
        let windows = self.windows();
        let parts = parts(fine.len() / of_fine);
        let mut coarse = vec![0.0; fine.len() / of_fine * of_coarse];
        coarse.par_chunks_mut(of_coarse).zip(fine.par_chunks(of_fine)).for_each_init(
            Vec::new,
            |scratch, (coarse, fine)| {
                correlate(&windows, fine, kernel, bias, coarse, parts, scratch);
            },
        );
        coarse
    }

    /// fine`[i, n]` = bias`[i]` + Σ kernel`[o, i, k]` coarse`[o, j]` over all j and k with
    /// `stride j + k - padding = n`.
    ///
    /// The samples n of equal remainder r by the stride see the same taps, and are a correlation
    /// with these, in reverse order.
    pub fn adjoint(&self, coarse: &[f32], kernel: &[f32], bias: Option<&[f32]>) -> Vec<f32> {
        let of_fine = self.fine_channels * self.fine_samples;
        let of_coarse = self.coarse_channels * self.coarse_samples;
        let phases: Vec<_> = (0..self.stride.min(self.fine_samples))
            .map(|remainder| self.phase(remainder, kernel))
            .collect();
        let parts = parts(coarse.len() / of_coarse);
        let mut fine = vec![0.0; coarse.len() / of_coarse * of_fine];
        fine.par_chunks_mut(of_fine).zip(coarse.par_chunks(of_coarse)).for_each_init(
            || (Vec::new(), Vec::new()),
            |(scratch, of_phase), (fine, coarse)| {
                if let [(windows, kernel)] = phases.as_slice() {
                    return correlate(windows, coarse, kernel, bias, fine, parts, scratch);
                }
                for (remainder, (windows, kernel)) in phases.iter().enumerate() {
                    of_phase.resize(self.fine_channels * windows.count, 0.0);
                    correlate(windows, coarse, kernel, bias, of_phase, parts, scratch);
                    let rows = fine.chunks_exact_mut(self.fine_samples);
                    for (fine, values) in rows.zip(of_phase.chunks_exact(windows.count)) {
                        let fine = fine[remainder..].iter_mut().step_by(self.stride);
                        for (fine, &value) in fine.zip(values) {
                            *fine = value;
                        }
                    }
                }
            },
        );
        fine
    }

    /// Gradient of the kernel: `[o, i, k]` = Σ coarse`[o, j]` fine`[i, stride j + k - padding]`,
    /// over trajectories too.
    ///
    /// Tasks share out the fine channels, so that every sum is one task's.
    pub fn kernel_gradient(&self, fine: &[f32], coarse: &[f32]) -> Vec<f32> {
        let (outputs, kernel) = (self.coarse_channels, self.kernel);
        let together = (DEPTH / self.coarse_samples).max(1);
        let depth = together * self.coarse_samples;
        let task = (CACHEFUL / (kernel * depth))
            .min(self.fine_channels.div_ceil(rayon::current_num_threads()))
            .max(1);
        // A row for each fine channel and tap.
        let mut gradient = vec![0.0; self.fine_channels * kernel * outputs];
        gradient.par_chunks_mut(task * kernel * outputs).enumerate().for_each(
            |(index, gradient)| {
                let channels = gradient.len() / (kernel * outputs);
                let windows = Windows { channels, ..self.windows() };
                let mut seen = vec![0.0; windows.rows() * depth];
                let mut values = vec![0.0; outputs * depth];
                let mut mode = Output::Overwrite;
                let fine = fine.chunks(together * self.fine_channels * self.fine_samples);
                let coarse = coarse.chunks(together * outputs * self.coarse_samples);
                for (fine, coarse) in fine.zip(coarse) {
                    let mut width = 0;
                    let fine = fine.chunks_exact(self.fine_channels * self.fine_samples);
                    let coarse = coarse.chunks_exact(outputs * self.coarse_samples);
                    for (fine, coarse) in fine.zip(coarse) {
                        let fine = &fine[index * task * self.fine_samples..];
                        windows.write_all(fine, &mut seen[width..], depth);
                        let rows = values.chunks_exact_mut(depth);
                        for (row, coarse) in rows.zip(coarse.chunks_exact(self.coarse_samples)) {
                            row[width..width + self.coarse_samples].copy_from_slice(coarse);
                        }
                        width += self.coarse_samples;
                    }
                    let seen = Matrix::new(&seen, windows.rows(), width, depth);
                    let values = Matrix::new(&values, outputs, width, depth).transposed();
                    multiply(1.0, seen, values, gradient, outputs, mode);
                    mode = Output::Add;
                }
            },
        );
        transposed(&gradient, outputs)
    }

    /// What the kernel sees of the fine series.
    fn windows(&self) -> Windows {
        Windows {
            channels: self.fine_channels,
            samples: self.fine_samples,
            taps: self.kernel,
            first: -self.padding.cast_signed(),
            step: self.stride,
            count: self.coarse_samples,
        }
    }

    /// What the fine samples of this remainder see of the coarse series, and with what kernel
    /// `[fine channel, coarse channel, tap]`.
    fn phase(&self, remainder: usize, kernel: &[f32]) -> (Windows, Vec<f32>) {
        let shifted = remainder + self.padding;
        let first_tap = shifted % self.stride;
        let taps = self.kernel.saturating_sub(first_tap).div_ceil(self.stride);
        let windows = Windows {
            channels: self.coarse_channels,
            samples: self.coarse_samples,
            taps,
            first: (shifted / self.stride + 1).cast_signed() - taps.cast_signed(),
            step: 1,
            count: (self.fine_samples - remainder).div_ceil(self.stride),
        };
        let mut of_phase = vec![0.0; self.fine_channels * windows.rows()];
        if taps > 0 {
            of_phase.par_chunks_mut(windows.rows()).enumerate().for_each(|(fine, row)| {
                for (coarse, row) in row.chunks_exact_mut(taps).enumerate() {
                    let start = (coarse * self.fine_channels + fine) * self.kernel;
                    let seen = kernel[start..start + self.kernel].iter().skip(first_tap);
                    for (value, &seen) in row.iter_mut().rev().zip(seen.step_by(self.stride)) {
                        *value = seen;
                    }
                }
            });
        }
        (windows, of_phase)
    }
}

/// Sum of each channel of series `[batch, channel, sample]`: the gradient of a bias.
pub(super) fn channel_sums(series: &[f32], channels: usize, samples: usize) -> Vec<f32> {
    let mut parts = vec![0.0; series.len() / samples];
    parts.par_chunks_mut(channels).zip(series.par_chunks(channels * samples)).for_each(
        |(sums, rows)| {
            vectorized::row_sums(rows, samples, sums);
        },
    );
    let mut sums = vec![0.0; channels];
    vectorized::add_rows(&parts, channels, &mut sums);
    sums
}

/// How many tasks a trajectory is shared out to: one, unless there are too few trajectories to
/// give every thread its own.
fn parts(batch: usize) -> usize {
    let threads = rayon::current_num_threads();
    if batch < threads { threads } else { 1 }
}

/// `kernel · windows + bias` of one trajectory, its output channels in `parts` tasks.
fn correlate(
    windows: &Windows,
    series: &[f32],
    kernel: &[f32],
    bias: Option<&[f32]>,
    output: &mut [f32],
    parts: usize,
    scratch: &mut Vec<f32>,
) {
    let (rows, count) = (windows.rows(), windows.count);
    let channels = output.len() / count;
    if let Some(bias) = bias {
        for (row, &bias) in output.chunks_exact_mut(count).zip(bias) {
            row.fill(bias);
        }
    }
    if rows == 0 {
        if bias.is_none() {
            output.fill(0.0);
        }
        return;
    }
    let mode = if bias.is_some() { Output::Add } else { Output::Overwrite };
    let task = channels.div_ceil(parts);
    let block = (CACHEFUL / rows).max(FEWEST_WINDOWS);
    for from in (0..count).step_by(block) {
        let seen = windows.matrix(series, from, block.min(count - from), scratch);
        output.par_chunks_mut(task * count).zip(kernel.par_chunks(task * rows)).for_each(
            |(output, kernel)| {
                let mut mode = mode;
                for first in (0..rows).step_by(TERMS) {
                    let terms = TERMS.min(rows - first);
                    let kernel = Matrix::new(&kernel[first..], kernel.len() / rows, terms, rows);
                    let seen = seen.rows(first, terms);
                    multiply(1.0, kernel, seen, &mut output[from..], count, mode);
                    mode = Output::Add;
                }
            },
        );
    }
}

/// The rows of `width` elements as columns.
fn transposed(rows: &[f32], width: usize) -> Vec<f32> {
    let height = rows.len() / width;
    let mut columns = vec![0.0; rows.len()];
    columns.par_chunks_mut(height).enumerate().for_each(|(index, column)| {
        for (value, &element) in column.iter_mut().zip(rows[index..].iter().step_by(width)) {
            *value = element;
        }
    });
    columns
}
