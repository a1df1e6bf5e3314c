//! Correlations with kernels of five taps in two fifths of the products: minimal filtering (Winograd
//! 1980) as Lavin and Gray (2016) use it.
//!
//! Four outputs need 20 products of samples and taps. As values of polynomials at eight points, of the
//! samples and of the taps, they need one for each point; what the products say at the points is turned
//! back into outputs. Sums over channels are products of matrices at each point apart. The points are 0,
//! ±1, ±1/2, ±2 and ∞, which keep what single precision loses near what a plain sum loses.

use std::cell::Cell;
use std::ops::Range;

use rayon::prelude::*;

use super::instruction_set::InstructionSet;
use super::panels::Panels;
use super::parts::in_parts;
use super::product::{Left, Onto, Right, multiply};
use super::vectorized::vectorized;
use super::windows::Windows;

const TAPS: usize = 5;

/// Of a tile.
const OUTPUTS: usize = 4;
const POINTS: usize = OUTPUTS + TAPS - 1;

/// Fewer channels, windows or series to share among threads are not worth the way to the points and back.
const CHANNELS: usize = 16;
const WINDOWS: usize = 1024;
const SERIES: usize = 4;

/// Tiles that are multiplied at once, if trajectories are shorter.
const TOGETHER: usize = 216;

/// Output channels whose products are kept until they are outputs, a multiple of a tile's rows.
const ROWS: usize = 48;

/// Columns of a task are a multiple of these, as of the widest vectors'.
const LANES: usize = 16;

/// Whether it pays for a correlation with `outputs` channels that sees these windows of `batch` series.
pub(super) fn pays(windows: &Windows, outputs: usize, batch: usize) -> bool {
    let Windows { channels, taps, step, count, .. } = *windows;
    taps == TAPS
        && step == 1
        && channels.min(outputs) >= CHANNELS
        && batch >= SERIES
        && batch * count >= WINDOWS
}

/// `kernel · windows + bias` of all trajectories, to `outputs` channels.
pub(super) fn correlate(
    windows: &Windows,
    series: &[f32],
    kernel: &[f32],
    bias: Option<&[f32]>,
    outputs: usize,
) -> Vec<f32> {
    let Windows { channels, samples, count, .. } = *windows;
    let tiles = Tiles::of(windows);
    let batch = series.len() / (channels * samples);
    let together = tiles.together().min(batch.div_ceil(rayon::current_num_threads()));
    let kernel = kernel_at_points(kernel, outputs, channels);
    let correlation = Correlation { tiles, kernel, bias, outputs };
    let (output, _) = in_parts(
        batch * outputs * count,
        together * outputs * count,
        || (),
        |(), index, output| {
            let first = index * together * channels * samples;
            let length = output.len() / (outputs * count) * channels * samples;
            with_scratch(|scratch| {
                correlation.write(&series[first..first + length], output, scratch);
            });
        },
    );
    output
}

/// One whose kernel is known at the points.
struct Correlation<'a> {
    tiles: Tiles,
    /// `[point, output, input]`
    kernel: Vec<f32>,
    bias: Option<&'a [f32]>,
    outputs: usize,
}

impl Correlation<'_> {
    /// Outputs of some trajectories, of a few channels at a time.
    fn write(&self, series: &[f32], output: &mut [f32], scratch: &mut Scratch) {
        let columns = self.tiles.at_points(series, scratch);
        for first in (0..self.outputs).step_by(ROWS) {
            let channels = first..self.outputs.min(first + ROWS);
            self.multiply(channels.clone(), columns, scratch);
            self.finish(channels, columns, &scratch.products, output);
        }
    }

    /// The products at each point, in rows of `columns`.
    fn multiply(&self, outputs: Range<usize>, columns: usize, scratch: &mut Scratch) {
        let channels = self.tiles.windows.channels;
        let rows: Vec<usize> = outputs.map(|output| output * channels).collect();
        let terms: Vec<usize> = (0..channels).map(|row| row * columns).collect();
        let Scratch { points, products, .. } = scratch;
        products.resize(POINTS * ROWS * columns, 0.0);
        let factors = self.kernel.chunks_exact(self.outputs * channels);
        let factors = factors.zip(points.chunks_exact(channels * columns));
        for ((kernel, series), to) in factors.zip(products.chunks_exact_mut(ROWS * columns)) {
            let left = Left { values: kernel, rows: &rows, step: 1 };
            let right = Right { values: series, terms: &terms };
            multiply(left, right, Onto::Nothing, to, columns, columns);
        }
    }

    /// Outputs of the products.
    fn finish(&self, outputs: Range<usize>, columns: usize, products: &[f32], output: &mut [f32]) {
        let Tiles { windows: Windows { count, .. }, count: tiles } = self.tiles;
        for (trajectory, output) in output.chunks_exact_mut(self.outputs * count).enumerate() {
            let series = output[outputs.start * count..].chunks_exact_mut(count);
            for ((row, channel), series) in outputs.clone().enumerate().zip(series) {
                let at = row * columns + trajectory * tiles;
                let products =
                    std::array::from_fn(|point| &products[point * ROWS * columns + at..][..tiles]);
                outputs_of_products(products, self.bias.map_or(0.0, |bias| bias[channel]), series);
            }
        }
    }
}

/// Gradient of the kernel of a correlation that sees `windows` of `fine` series, given that of its
/// outputs, `coarse`.
///
/// Tasks share out the output channels, so that every sum is one task's.
pub(super) fn kernel_gradient(
    windows: &Windows,
    fine: &[f32],
    coarse: &[f32],
    outputs: usize,
) -> Vec<f32> {
    let Windows { channels, samples, count, .. } = *windows;
    let tiles = Tiles::of(windows);
    let together = tiles.together();
    let task = outputs.div_ceil(rayon::current_num_threads()).next_multiple_of(LANES);
    let mut gradient = vec![0.0; outputs * channels * TAPS];
    let tasks = gradient.par_chunks_mut(task * channels * TAPS).enumerate();
    tasks.for_each(|(index, gradient)| {
        with_scratch(|scratch| {
            let here = gradient.len() / (channels * TAPS);
            let mut onto = Onto::Nothing;
            scratch.sums.resize(POINTS * channels * here, 0.0);
            let fine = fine.chunks(together * channels * samples);
            let coarse = coarse.chunks(together * outputs * count);
            for (fine, coarse) in fine.zip(coarse) {
                let columns = coarse.len() / (outputs * count) * tiles.count;
                let outputs_here = index * task..index * task + here;
                tiles.at_points(fine, scratch);
                tiles.gradients_at_points(coarse, outputs, outputs_here, scratch);
                let rows: Vec<usize> = (0..channels).map(|row| row * columns).collect();
                let Scratch { points, products, sums, panels, .. } = &mut *scratch;
                for point in 0..POINTS {
                    let values = &products[point * here * columns..][..here * columns];
                    panels.write_columns(values, columns, here, columns);
                    let values = &points[point * channels * columns..][..channels * columns];
                    let left = Left { values, rows: &rows, step: 1 };
                    let sums = &mut sums[point * channels * here..][..channels * here];
                    panels.multiply(left, onto, sums, here);
                }
                onto = Onto::Output;
            }
            let mut taps = [(); TAPS].map(|()| vec![0.0; here]);
            for channel in 0..channels {
                let sums = std::array::from_fn(|point| {
                    &scratch.sums[(point * channels + channel) * here..][..here]
                });
                taps_of_points(sums, taps.each_mut().map(Vec::as_mut_slice));
                let rows = gradient.chunks_exact_mut(channels * TAPS);
                for (output, row) in rows.enumerate() {
                    for (tap, taps) in row[channel * TAPS..][..TAPS].iter_mut().zip(&taps) {
                        *tap = taps[output];
                    }
                }
            }
        })
    });
    gradient
}

/// Windows in groups of four neighbours.
#[derive(Clone, Copy)]
struct Tiles {
    windows: Windows,
    /// Of a trajectory.
    count: usize,
}

/// What a task writes to before it writes its results.
#[derive(Default)]
struct Scratch {
    /// A series with zeros at its ends.
    padded: Vec<f32>,
    /// `[point, channel, column]`; a column is a tile of a trajectory.
    points: Vec<f32>,
    /// The same of output channels.
    products: Vec<f32>,
    /// Of the derivative of a kernel: a row for each point and fine channel.
    sums: Vec<f32>,
    panels: Panels,
}

thread_local! {
    /// Of operations to come: to get memory from the system takes as long as to fill it.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// The thread's scratch, which nothing else uses meanwhile.
fn with_scratch<T>(work: impl FnOnce(&mut Scratch) -> T) -> T {
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let result = work(&mut scratch);
    SCRATCH.set(Some(scratch));
    result
}

impl Tiles {
    fn of(windows: &Windows) -> Self {
        Self { windows: *windows, count: windows.count.div_ceil(OUTPUTS) }
    }

    /// Trajectories that are multiplied at once.
    fn together(&self) -> usize {
        (TOGETHER / self.count).max(1)
    }

    /// Of a padded series: whole blocks of tiles, and what the last one sees beyond its outputs.
    fn padded_length(&self) -> usize {
        OUTPUTS * (self.count.next_multiple_of(LANES) + 1)
    }

    /// Series of some trajectories as values at the points, in rows of how many columns it gives.
    fn at_points(&self, series: &[f32], scratch: &mut Scratch) -> usize {
        let Windows { channels, samples, first, .. } = self.windows;
        let columns = series.len() / (channels * samples) * self.count;
        let Scratch { padded, points, .. } = scratch;
        padded.clear();
        padded.resize(self.padded_length(), 0.0);
        // The first window begins before the series or within it.
        let (before, skipped) = (first.min(0).unsigned_abs(), first.max(0).unsigned_abs());
        let seen = samples.saturating_sub(skipped).min(padded.len() - before);
        points.resize(POINTS * channels * columns, 0.0);
        let mut points: Vec<&mut [f32]> = points.chunks_exact_mut(channels * columns).collect();
        for (index, series) in series.chunks_exact(samples).enumerate() {
            let (trajectory, channel) = (index / channels, index % channels);
            padded[before..before + seen].copy_from_slice(&series[skipped..][..seen]);
            let at = channel * columns + trajectory * self.count;
            points_of_series(padded, self.count, at, &mut points);
        }
        columns
    }

    /// Derivatives of those `outputs` of `all` channels of some trajectories as values at the points.
    fn gradients_at_points(
        &self,
        coarse: &[f32],
        all: usize,
        outputs: Range<usize>,
        scratch: &mut Scratch,
    ) {
        let samples = self.windows.count;
        let columns = coarse.len() / (all * samples) * self.count;
        let Scratch { padded, products, .. } = scratch;
        padded.clear();
        padded.resize(self.padded_length(), 0.0);
        products.resize(POINTS * outputs.len() * columns, 0.0);
        let mut points: Vec<&mut [f32]> =
            products.chunks_exact_mut(outputs.len() * columns).collect();
        for (trajectory, coarse) in coarse.chunks_exact(all * samples).enumerate() {
            let coarse = coarse[outputs.start * samples..outputs.end * samples].chunks(samples);
            for (output, coarse) in coarse.enumerate() {
                padded[..samples].copy_from_slice(coarse);
                let at = output * columns + trajectory * self.count;
                points_of_outputs(padded, self.count, at, &mut points);
            }
        }
    }
}

/// `[point, output, input]` of a kernel `[output, input, tap]`.
fn kernel_at_points(kernel: &[f32], outputs: usize, inputs: usize) -> Vec<f32> {
    let mut points = vec![0.0; POINTS * outputs * inputs];
    let mut rows: Vec<Vec<&mut [f32]>> = (0..outputs).map(|_| Vec::new()).collect();
    for point in points.chunks_exact_mut(outputs * inputs) {
        for (rows, row) in rows.iter_mut().zip(point.chunks_exact_mut(inputs)) {
            rows.push(row);
        }
    }
    rows.par_iter_mut().zip(kernel.par_chunks(inputs * TAPS)).for_each(|(points, taps)| {
        points_of_taps(taps, points);
    });
    points
}

/// A vector of the widest.
type Block = [f32; LANES];

/// Every fourth number from each of the first four on.
#[inline(always)]
fn apart(block: &[f32]) -> [Block; OUTPUTS] {
    let mut phases = [[0.0; LANES]; OUTPUTS];
    let (quads, _) = block.as_chunks::<OUTPUTS>();
    for (lane, quad) in quads.iter().take(LANES).enumerate() {
        for phase in 0..OUTPUTS {
            phases[phase][lane] = quad[phase];
        }
    }
    phases
}

/// The numbers of [`apart`] in turn.
#[inline(always)]
fn in_turn(phases: &[Block; OUTPUTS]) -> [f32; OUTPUTS * LANES] {
    let mut block = [0.0; OUTPUTS * LANES];
    let (quads, _) = block.as_chunks_mut::<OUTPUTS>();
    for (lane, quad) in quads.iter_mut().enumerate() {
        for phase in 0..OUTPUTS {
            quad[phase] = phases[phase][lane];
        }
    }
    block
}

/// Up to a block of numbers from `at` on, zeros beyond.
#[inline(always)]
fn block_at(values: &[f32], at: usize) -> Block {
    let values = &values[at..];
    if let Some(block) = values.first_chunk::<LANES>() {
        return *block;
    }
    let mut block = [0.0; LANES];
    for (number, &value) in block.iter_mut().zip(values) {
        *number = value;
    }
    block
}

#[inline(always)]
fn blocks_at(points: &[&[f32]; POINTS], at: usize) -> [Block; POINTS] {
    let mut blocks = [[0.0; LANES]; POINTS];
    for (block, point) in blocks.iter_mut().zip(points) {
        *block = block_at(point, at);
    }
    blocks
}

/// Up to a block of numbers to each point's place.
#[inline(always)]
fn put(values: &[Block; POINTS], at: usize, count: usize, points: &mut [&mut [f32]]) {
    for (values, point) in values.iter().zip(points) {
        let place = &mut point[at..at + count];
        if let Some(place) = place.first_chunk_mut::<LANES>() {
            *place = *values;
        } else {
            for (place, &value) in place.iter_mut().zip(values) {
                *place = value;
            }
        }
    }
}

vectorized! {
    /// Values at the points of the `count` tiles of a padded series, each to the place of its point from
    /// `at` on.
    fn points_of_series(padded: &[f32], count: usize, at: usize, points: &mut [&mut [f32]]) {
        for first in (0..count).step_by(LANES) {
            let [x0, x1, x2, x3] = apart(&padded[OUTPUTS * first..][..OUTPUTS * LANES]);
            let [x4, x5, x6, x7] = apart(&padded[OUTPUTS * (first + 1)..][..OUTPUTS * LANES]);
            let mut values = [[0.0; LANES]; POINTS];
            for lane in 0..LANES {
                let [a, b, c, d] = [x0[lane], x1[lane], x2[lane], x3[lane]];
                let [e, f, g, h] = [x4[lane], x5[lane], x6[lane], x7[lane]];
                // Of points of either sign what is even and what is odd in them.
                let (even, odd) = (c + g - 4.25 * e, b + f - 4.25 * d);
                values[1][lane] = even + odd;
                values[2][lane] = even - odd;
                let (even, odd) = (4.0 * c + g - 5.0 * e, 2.0 * b + 0.5 * f - 2.5 * d);
                values[3][lane] = even + odd;
                values[4][lane] = even - odd;
                let (even, odd) = (0.25 * c + g - 1.25 * e, 0.5 * b + 2.0 * f - 2.5 * d);
                values[5][lane] = even + odd;
                values[6][lane] = even - odd;
                values[0][lane] = g - a + 5.25 * (c - e);
                values[7][lane] = h - b + 5.25 * (d - f);
            }
            put(&values, at + first, LANES.min(count - first), points);
        }
    }
}

vectorized! {
    /// The same of derivatives of outputs.
    fn points_of_outputs(padded: &[f32], count: usize, at: usize, points: &mut [&mut [f32]]) {
        for first in (0..count).step_by(LANES) {
            let [y0, y1, y2, y3] = apart(&padded[OUTPUTS * first..][..OUTPUTS * LANES]);
            let mut values = [[0.0; LANES]; POINTS];
            for lane in 0..LANES {
                let [a, b, c, d] = [y0[lane], y1[lane], y2[lane], y3[lane]];
                values[0][lane] = a;
                let (even, odd) = (a + c, b + d);
                values[1][lane] = even + odd;
                values[2][lane] = even - odd;
                let (even, odd) = (a + 0.25 * c, 0.5 * b + 0.125 * d);
                values[3][lane] = even + odd;
                values[4][lane] = even - odd;
                let (even, odd) = (a + 4.0 * c, 2.0 * b + 8.0 * d);
                values[5][lane] = even + odd;
                values[6][lane] = even - odd;
                values[7][lane] = d;
            }
            put(&values, at + first, LANES.min(count - first), points);
        }
    }
}

vectorized! {
    /// Values at the points of kernels that follow each other.
    fn points_of_taps(taps: &[f32], points: &mut [&mut [f32]]) {
        let (kernels, _) = taps.as_chunks::<TAPS>();
        for (block, kernels) in kernels.chunks(LANES).enumerate() {
            let mut taps = [[0.0; LANES]; TAPS];
            for (lane, kernel) in kernels.iter().enumerate() {
                for tap in 0..TAPS {
                    taps[tap][lane] = kernel[tap];
                }
            }
            let mut values = [[0.0; LANES]; POINTS];
            for lane in 0..LANES {
                let [a, b, c, d, e] =
                    [taps[0][lane], taps[1][lane], taps[2][lane], taps[3][lane], taps[4][lane]];
                values[0][lane] = -a;
                let (even, odd) = ((a + c + e) * (-2.0 / 9.0), (b + d) * (-2.0 / 9.0));
                values[1][lane] = even + odd;
                values[2][lane] = even - odd;
                let (even, odd) =
                    ((16.0 * a + 4.0 * c + e) * (2.0 / 45.0), (8.0 * b + 2.0 * d) * (2.0 / 45.0));
                values[3][lane] = even + odd;
                values[4][lane] = even - odd;
                let (even, odd) =
                    ((a + 4.0 * c + 16.0 * e) * (1.0 / 90.0), (2.0 * b + 8.0 * d) * (1.0 / 90.0));
                values[5][lane] = even + odd;
                values[6][lane] = even - odd;
                values[7][lane] = e;
            }
            put(&values, LANES * block, kernels.len(), points);
        }
    }
}

vectorized! {
    /// Outputs of what the products say at the points, and `bias`.
    fn outputs_of_products(products: [&[f32]; POINTS], bias: f32, outputs: &mut [f32]) {
        for (block, outputs) in outputs.chunks_mut(OUTPUTS * LANES).enumerate() {
            let [zero, a, b, c, d, e, f, infinity] = blocks_at(&products, LANES * block);
            let mut phases = [[0.0; LANES]; OUTPUTS];
            for lane in 0..LANES {
                let (one, half, two) = (a[lane] + b[lane], c[lane] + d[lane], e[lane] + f[lane]);
                phases[0][lane] = zero[lane] + bias + one + half + two;
                phases[2][lane] = bias + one + 0.25 * half + 4.0 * two;
                let (one, half, two) = (a[lane] - b[lane], c[lane] - d[lane], e[lane] - f[lane]);
                phases[1][lane] = bias + one + 0.5 * half + 2.0 * two;
                phases[3][lane] = infinity[lane] + bias + one + 0.125 * half + 8.0 * two;
            }
            let values = in_turn(&phases);
            if let Some(outputs) = outputs.first_chunk_mut() {
                *outputs = values;
            } else {
                outputs.copy_from_slice(&values[..outputs.len()]);
            }
        }
    }
}

vectorized! {
    /// Derivatives of taps, of those of their values at the points.
    fn taps_of_points(points: [&[f32]; POINTS], taps: [&mut [f32]; TAPS]) {
        let [ta, tb, tc, td, te] = taps;
        for first in (0..ta.len()).step_by(LANES) {
            let [zero, a, b, c, d, e, f, infinity] = blocks_at(&points, first);
            let mut values = [[0.0; LANES]; TAPS];
            for lane in 0..LANES {
                let one = (a[lane] + b[lane]) * (-2.0 / 9.0);
                let half = (c[lane] + d[lane]) * (2.0 / 45.0);
                let two = (e[lane] + f[lane]) * (1.0 / 90.0);
                values[0][lane] = one + 16.0 * half + two - zero[lane];
                values[2][lane] = one + 4.0 * half + 4.0 * two;
                values[4][lane] = one + half + 16.0 * two + infinity[lane];
                let one = (a[lane] - b[lane]) * (-2.0 / 9.0);
                let half = (c[lane] - d[lane]) * (2.0 / 45.0);
                let two = (e[lane] - f[lane]) * (1.0 / 90.0);
                values[1][lane] = one + 8.0 * half + 2.0 * two;
                values[3][lane] = one + 2.0 * half + 8.0 * two;
            }
            let places = [&mut *ta, &mut *tb, &mut *tc, &mut *td, &mut *te];
            for (place, values) in places.into_iter().zip(&values) {
                let count = LANES.min(place.len() - first);
                place[first..first + count].copy_from_slice(&values[..count]);
            }
        }
    }
}
