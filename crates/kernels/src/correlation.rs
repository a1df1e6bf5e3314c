//! Cross-correlation along the last dimension, its adjoint and the gradient of its kernel. The
//! backward pass of each consists of the others, and also that of the transposed convolution.
//!
//! Each is a matrix product, in which one factor has the windows that the kernel sees. The windows
//! overlap and are never written out. Large correlations with five taps use [`winograd`] instead.

use rayon::prelude::*;

use super::panels::Panels;
use super::parts::in_parts;
use super::product::{Left, Offsets, Onto, Right, multiply};
use super::vectorized;
use super::windows::Windows;
use super::winograd;

/// Samples that are computed together if trajectories are shorter. Fewer do not fill vectors, and
/// they would read the kernels of deep stages, which are larger than the caches, too often.
const TOGETHER: usize = 432;

/// The rows of a task are a multiple of this, the rows of a register tile.
const TILE_ROWS: usize = 6;

/// The columns of a task are a multiple of this, the width of the widest vectors.
const LANES: usize = 16;

/// A correlation of fine series `[batch, fine channel, fine sample]` with a kernel `[coarse
/// channel, fine channel, kernel]`. It gives coarse series `[batch, coarse channel, coarse sample]`
/// and takes zeros beyond the ends.
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
        correlate(&self.windows(), fine, kernel, bias, self.coarse_channels)
    }

    /// Whether [`Correlation::forward`] uses tiles.
    pub fn is_tiled(&self) -> bool {
        winograd::pays(&self.windows(), self.coarse_channels)
    }

    /// The kernel for [`Correlation::forward_tiled`].
    pub fn at_points(&self, kernel: &[f32]) -> Vec<f32> {
        winograd::kernel_at_points(kernel, self.coarse_channels, self.fine_channels)
    }

    /// [`Correlation::forward`] with a kernel of [`Correlation::at_points`].
    pub fn forward_tiled(&self, fine: &[f32], kernel: &[f32], bias: Option<&[f32]>) -> Vec<f32> {
        winograd::correlate(&self.windows(), fine, kernel, bias, self.coarse_channels)
    }

    /// fine`[i, n]` = bias`[i]` + Σ kernel`[o, i, k]` coarse`[o, j]` over all j and k with
    /// `stride j + k - padding = n`.
    ///
    /// All samples n with the same remainder r by the stride see the same taps. They are a
    /// correlation with these taps in reverse order.
    pub fn adjoint(&self, coarse: &[f32], kernel: &[f32], bias: Option<&[f32]>) -> Vec<f32> {
        let of_coarse = self.coarse_channels * self.coarse_samples;
        let batch = coarse.len() / of_coarse;
        let phases = self.stride.min(self.fine_samples);
        if phases == 1 {
            let (windows, kernel) = self.phase(0, kernel);
            return correlate(&windows, coarse, &kernel, bias, self.fine_channels);
        }
        let mut fine = vec![0.0; batch * self.fine_channels * self.fine_samples];
        for remainder in 0..phases {
            let (windows, kernel) = self.phase(remainder, kernel);
            let of_phase = correlate(&windows, coarse, &kernel, bias, self.fine_channels);
            let rows = fine.par_chunks_exact_mut(self.fine_samples);
            rows.zip(of_phase.par_chunks_exact(windows.count)).for_each(|(fine, values)| {
                let fine = fine[remainder..].iter_mut().step_by(self.stride);
                for (fine, &value) in fine.zip(values) {
                    *fine = value;
                }
            });
        }
        fine
    }

    /// Gradient of the kernel: `[o, i, k]` = Σ coarse`[o, j]` fine`[i, stride j + k - padding]`,
    /// also summed over trajectories.
    ///
    /// Tasks divide the coarse channels, so that each sum belongs to one task.
    pub fn kernel_gradient(&self, fine: &[f32], coarse: &[f32]) -> Vec<f32> {
        let (outputs, samples) = (self.coarse_channels, self.coarse_samples);
        let windows = self.windows();
        if winograd::pays(&windows, outputs) {
            return winograd::kernel_gradient(&windows, fine, coarse, outputs);
        }
        let length = windows.length();
        let together = group(length);
        let task = outputs.div_ceil(rayon::current_num_threads()).next_multiple_of(LANES);
        let mut gradient = vec![0.0; outputs * windows.rows()];
        gradient.par_chunks_mut(task * windows.rows()).enumerate().for_each(|(index, gradient)| {
            let outputs_here = gradient.len() / windows.rows();
            // A row for each fine channel and tap.
            let mut sums = vec![0.0; gradient.len()];
            let mut onto = Onto::Nothing;
            let (mut scratch, mut values) = (Vec::new(), Vec::new());
            let mut panels = Panels::default();
            let fine = fine.chunks(together * self.fine_channels * self.fine_samples);
            let coarse = coarse.chunks(together * outputs * samples);
            for (fine, coarse) in fine.zip(coarse) {
                let seen = windows.see(fine, &mut scratch);
                // The coarse samples in the layout of the windows, with zeros where a window spans
                // two trajectories.
                values.clear();
                values.resize(outputs_here * seen.row, 0.0);
                for (trajectory, coarse) in coarse.chunks_exact(outputs * samples).enumerate() {
                    let rows = values.chunks_exact_mut(seen.row);
                    let coarse = coarse[index * task * samples..].chunks_exact(samples);
                    for (row, coarse) in rows.zip(coarse) {
                        row[trajectory * length..][..samples].copy_from_slice(coarse);
                    }
                }
                // The product ends at the last window, because later taps would leave the row.
                let depth = seen.row - (length - samples);
                panels.write_columns(&values, [depth, outputs_here], seen.row);
                let offsets = windows.offsets(seen.row);
                let left = Left { values: seen.values, rows: Offsets::of(&offsets), step: 1 };
                panels.multiply(left, onto, &mut sums, outputs_here);
                onto = Onto::Output;
            }
            for (output, row) in gradient.chunks_exact_mut(windows.rows()).enumerate() {
                let column = sums[output..].iter().step_by(outputs_here);
                for (value, &sum) in row.iter_mut().zip(column) {
                    *value = sum;
                }
            }
        });
        gradient
    }

    /// The windows that the kernel sees in the fine series.
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

    /// For the fine samples with this remainder, their windows in the coarse series and the kernel
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

/// Number of trajectories of this length that are computed together.
fn group(length: usize) -> usize {
    (TOGETHER / length.max(1)).max(1)
}

/// `kernel · windows + bias` of all trajectories. A task has a few trajectories. If there are fewer
/// tasks than threads, the output channels are divided, too.
fn correlate(
    windows: &Windows,
    series: &[f32],
    kernel: &[f32],
    bias: Option<&[f32]>,
    channels: usize,
) -> Vec<f32> {
    let (of_series, count, length) =
        (windows.channels * windows.samples, windows.count, windows.length());
    let batch = series.len() / of_series;
    if winograd::pays(windows, channels) {
        let kernel = winograd::kernel_at_points(kernel, channels, windows.channels);
        return winograd::correlate(windows, series, &kernel, bias, channels);
    }
    let threads = rayon::current_num_threads();
    let together = group(length).min(batch.div_ceil(threads));
    let task = match batch.div_ceil(together) {
        groups if groups < threads => channels.div_ceil(2 * threads).next_multiple_of(TILE_ROWS),
        _ => channels,
    };
    let kernel_rows: Vec<usize> = (0..channels).map(|row| row * windows.rows()).collect();
    let (output, _) = in_parts(
        batch * channels * count,
        together * channels * count,
        || (Vec::new(), Vec::new()),
        |(scratch, results), index, output| {
            let series = &series[index * together * of_series..];
            let series = &series[..output.len() / (channels * count) * of_series];
            let alone = series.len() == of_series;
            let seen = windows.see(series, scratch);
            let offsets = windows.offsets(seen.row);
            let right = Right { values: seen.values, terms: Offsets::of(&offsets) };
            // Windows that span two trajectories are computed, too, except those after the last.
            let columns = seen.row - (length - count);
            let stride = if alone { count } else { columns };
            let to: &mut [f32] = if alone {
                &mut *output
            } else {
                results.resize(channels * columns, 0.0);
                results
            };
            to.par_chunks_mut(task * stride).enumerate().for_each(|(index, to)| {
                let rows = index * task..index * task + to.len() / stride;
                let onto = match bias {
                    Some(bias) => Onto::Rows(&bias[rows.clone()]),
                    None => Onto::Nothing,
                };
                let rows = Offsets::of(&kernel_rows[rows]);
                let left = Left { values: kernel, rows, step: 1 };
                multiply(left, right, onto, to, columns, stride);
            });
            if alone {
                return;
            }
            for (trajectory, output) in output.chunks_exact_mut(channels * count).enumerate() {
                let rows = results.chunks_exact(columns);
                for (row, from) in output.chunks_exact_mut(count).zip(rows) {
                    row.copy_from_slice(&from[trajectory * length..][..count]);
                }
            }
        },
    );
    output
}
