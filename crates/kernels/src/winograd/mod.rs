//! Correlations with kernels of five taps in two fifths of the multiplications: minimal filtering
//! (Winograd 1980) in the form of Lavin and Gray (2016).
//!
//! Four outputs need 20 products of samples and taps. Samples and taps are also polynomials. Their
//! product is determined by its values at eight points, which needs one multiplication per point. A
//! linear transform turns these values back into outputs. Sums over channels are matrix products,
//! one for each point. The points are 0, ±1, ±1/2, ±2 and ∞, with which the rounding error stays
//! close to that of a plain sum.

mod points;

use std::cell::Cell;
use std::ops::Range;

use rayon::prelude::*;

use super::panels::{Panels, multiples};
use super::parts::each_part;
use super::product::{Left, Offsets, Onto, Right, multiply};
use super::windows::Windows;
use points::{
    outputs_of_products, points_of_outputs, points_of_series, points_of_taps, taps_of_points,
};

const TAPS: usize = 5;

/// Outputs of a tile.
const OUTPUTS: usize = 4;
const POINTS: usize = OUTPUTS + TAPS - 1;

/// With fewer channels or windows, the transforms cost more than they save, or the vectors of tiles
/// are not full.
const CHANNELS: usize = 16;
const WINDOWS: usize = 32;

/// Tiles that are multiplied together if trajectories are shorter.
const TOGETHER: usize = 216;

/// Output channels whose products are stored before the transform, a multiple of a register tile's
/// rows.
const ROWS: usize = 48;

/// The rows of a task are a multiple of this, the rows of a register tile.
const TILE_ROWS: usize = 6;

/// The columns of a task are a multiple of this, the width of the widest vectors.
const LANES: usize = 16;

/// Whether this is faster for a correlation with `outputs` channels and these windows. It does not
/// depend on the number of series, so that their results do not either.
pub(super) fn pays(windows: &Windows, outputs: usize) -> bool {
    let Windows { channels, taps, step, count, .. } = *windows;
    taps == TAPS && step == 1 && channels.min(outputs) >= CHANNELS && count >= WINDOWS
}

/// Transformed values that a convolution with a kernel `[output, input, tap]` of this shape and its
/// backward pass need, if they use tiles.
pub(super) fn scratch([outputs, inputs, taps]: [usize; 3]) -> usize {
    if taps == TAPS { 2 * POINTS * outputs * inputs } else { 0 }
}

/// `kernel · windows + bias` of all trajectories, to `outputs` channels. `kernel` is that of
/// [`kernel_at_points`].
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
    let correlation = TiledCorrelation { tiles, kernel, bias, outputs };
    if together == 1 && batch < rayon::current_num_threads() {
        let mut output = vec![0.0; batch * outputs * count];
        let each = output.chunks_exact_mut(outputs * count);
        for (output, series) in each.zip(series.chunks_exact(channels * samples)) {
            correlation.write_divided(series, output);
        }
        return output;
    }
    each_part(batch * outputs * count, together * outputs * count, |index, output| {
        let first = index * together * channels * samples;
        let length = output.len() / (outputs * count) * channels * samples;
        with_scratch(|scratch| {
            correlation.write(&series[first..first + length], output, scratch);
        });
    })
}

/// A correlation with a transformed kernel.
struct TiledCorrelation<'a> {
    tiles: Tiles,
    /// `[point, output, input]`
    kernel: &'a [f32],
    bias: Option<&'a [f32]>,
    outputs: usize,
}

impl TiledCorrelation<'_> {
    /// Writes the outputs of some trajectories, a few channels at a time.
    fn write(&self, series: &[f32], output: &mut [f32], scratch: &mut Scratch) {
        let Tiles { windows: Windows { channels, count, .. }, count: tiles } = self.tiles;
        let columns = self.tiles.at_points(series, scratch);
        let Scratch { points, products, .. } = scratch;
        let strides = [channels * columns, columns];
        for first in (0..self.outputs).step_by(ROWS) {
            let outputs = first..self.outputs.min(first + ROWS);
            self.multiply(outputs.clone(), columns, points, strides, products);
            for (trajectory, output) in output.chunks_exact_mut(self.outputs * count).enumerate() {
                let rows = &mut output[outputs.start * count..outputs.end * count];
                self.finish(outputs.start, columns, trajectory * tiles, products, rows);
            }
        }
    }

    /// Writes the outputs of one trajectory on all threads. They first divide its channels, and
    /// then those of the output.
    fn write_divided(&self, series: &[f32], output: &mut [f32]) {
        let Tiles { windows: Windows { channels, samples, first, count, .. }, count: tiles } =
            self.tiles;
        let tasks = 2 * rayon::current_num_threads();
        // With a stride of a power of two, rows would share few sets of the first-level cache.
        let apart = POINTS * tiles + LANES;
        let task = channels.div_ceil(tasks);
        let points = each_part(channels * apart, task * apart, |index, places| {
            let series = series[index * task * samples..].chunks_exact(samples);
            for (series, place) in series.zip(places.chunks_exact_mut(apart)) {
                points_of_series(series, first, tiles, 0, &mut by_point(place, tiles));
            }
        });
        let task = self.outputs.div_ceil(tasks).next_multiple_of(TILE_ROWS).min(ROWS);
        output.par_chunks_mut(task * count).enumerate().for_each(|(index, output)| {
            with_scratch(|Scratch { products, .. }| {
                let outputs = index * task..index * task + output.len() / count;
                self.multiply(outputs.clone(), tiles, &points, [tiles, apart], products);
                self.finish(outputs.start, tiles, 0, products, output);
            });
        });
    }

    /// The products at each point, with rows of `columns` elements. In `points`, the strides are
    /// those of points and of channels.
    fn multiply(
        &self,
        outputs: Range<usize>,
        columns: usize,
        points: &[f32],
        [of_point, of_channel]: [usize; 2],
        products: &mut Vec<f32>,
    ) {
        let channels = self.tiles.windows.channels;
        let (rows, terms) = (multiples(outputs.len(), channels), multiples(channels, of_channel));
        let (rows, terms) = (Offsets::of(&rows), Offsets::of(&terms));
        products.resize(POINTS * ROWS * columns, 0.0);
        let kernels = self.kernel.chunks_exact(self.outputs * channels).enumerate();
        for ((point, kernel), to) in kernels.zip(products.chunks_exact_mut(ROWS * columns)) {
            let left = Left { values: &kernel[outputs.start * channels..], rows, step: 1 };
            let right = Right { values: &points[point * of_point..], terms };
            multiply(left, right, Onto::Nothing, to, columns, columns);
        }
    }

    /// Transforms products into consecutive outputs of a trajectory, whose tiles begin at `first`.
    fn finish(
        &self,
        first_output: usize,
        columns: usize,
        first: usize,
        products: &[f32],
        output: &mut [f32],
    ) {
        let count = self.tiles.windows.count;
        for (row, series) in output.chunks_exact_mut(count).enumerate() {
            let at = row * columns + first;
            let products = std::array::from_fn(|point| &products[point * ROWS * columns + at..]);
            let bias = self.bias.map_or(0.0, |bias| bias[first_output + row]);
            outputs_of_products(products, bias, series);
        }
    }
}

/// Gradient of the kernel of a correlation with `windows` of the series `fine`, from the gradient
/// `coarse` of its outputs.
///
/// Tasks divide the output channels, so that each sum belongs to one task.
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
                let rows = multiples(channels, columns);
                let rows = Offsets::of(&rows);
                let Scratch { points, products, sums, panels, .. } = &mut *scratch;
                for point in 0..POINTS {
                    let values = &products[point * here * columns..][..here * columns];
                    panels.write_columns(values, [columns, here], columns);
                    let values = &points[point * channels * columns..][..channels * columns];
                    let left = Left { values, rows, step: 1 };
                    let sums = &mut sums[point * channels * here..][..channels * here];
                    panels.multiply(left, onto, sums, here);
                }
                onto = Onto::Output;
            }
            write_taps(&scratch.sums, here, gradient);
        })
    });
    gradient
}

/// Transforms sums over tiles `[point, channel, output]` into the gradient `[output, channel,
/// tap]`.
fn write_taps(sums: &[f32], outputs: usize, gradient: &mut [f32]) {
    let channels = gradient.len() / (outputs * TAPS);
    let mut taps = [(); TAPS].map(|()| vec![0.0; outputs]);
    for channel in 0..channels {
        let sums =
            std::array::from_fn(|point| &sums[(point * channels + channel) * outputs..][..outputs]);
        taps_of_points(sums, &mut taps.each_mut().map(Vec::as_mut_slice));
        for (output, row) in gradient.chunks_exact_mut(channels * TAPS).enumerate() {
            for (tap, taps) in row[channel * TAPS..][..TAPS].iter_mut().zip(&taps) {
                *tap = taps[output];
            }
        }
    }
}

/// Windows in groups of four neighbours.
#[derive(Clone, Copy)]
struct Tiles {
    windows: Windows,
    /// Tiles of a trajectory.
    count: usize,
}

/// Buffers of a task.
#[derive(Default)]
struct Scratch {
    /// `[point, channel, column]`. A column is a tile of a trajectory.
    points: Vec<f32>,
    /// `[point, output channel, column]`.
    products: Vec<f32>,
    /// Sums of the kernel's gradient: a row for each point and fine channel.
    sums: Vec<f32>,
    panels: Panels,
}

thread_local! {
    /// The buffers for later operations. Getting memory from the system takes as long as filling
    /// it.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// Runs `work` with the thread's buffers. Nothing else uses them meanwhile.
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

    /// Number of trajectories that are multiplied together.
    fn together(&self) -> usize {
        (TOGETHER / self.count).max(1)
    }

    /// Transforms the series of some trajectories. Gives the number of columns.
    fn at_points(&self, series: &[f32], scratch: &mut Scratch) -> usize {
        let Windows { channels, samples, first, .. } = self.windows;
        let columns = series.len() / (channels * samples) * self.count;
        scratch.points.resize(POINTS * channels * columns, 0.0);
        let mut points = by_point(&mut scratch.points, channels * columns);
        // In this order, numbers that are written beyond the last tile are overwritten later.
        for channel in 0..channels {
            for (trajectory, series) in series.chunks_exact(channels * samples).enumerate() {
                let series = &series[channel * samples..][..samples];
                let at = channel * columns + trajectory * self.count;
                points_of_series(series, first, self.count, at, &mut points);
            }
        }
        columns
    }

    /// Transforms the gradients of `outputs`, a range of `all` channels, of some trajectories.
    fn gradients_at_points(
        &self,
        coarse: &[f32],
        all: usize,
        outputs: Range<usize>,
        scratch: &mut Scratch,
    ) {
        let samples = self.windows.count;
        let columns = coarse.len() / (all * samples) * self.count;
        let products = &mut scratch.products;
        products.resize(POINTS * outputs.len() * columns, 0.0);
        let mut points = by_point(products, outputs.len() * columns);
        // See `at_points`.
        for (row, output) in outputs.enumerate() {
            for (trajectory, coarse) in coarse.chunks_exact(all * samples).enumerate() {
                let gradients = &coarse[output * samples..][..samples];
                points_of_outputs(gradients, row * columns + trajectory * self.count, &mut points);
            }
        }
    }
}

/// Transforms a kernel `[output, input, tap]` to `[point, output, input]`.
pub(super) fn kernel_at_points(kernel: &[f32], outputs: usize, inputs: usize) -> Vec<f32> {
    let mut points = vec![0.0; POINTS * outputs * inputs];
    let mut rows =
        by_point(&mut points, outputs * inputs).map(|point| point.chunks_exact_mut(inputs));
    let mut rows: Vec<[&mut [f32]; POINTS]> = (0..outputs)
        .map(|_| rows.each_mut().map(|rows| rows.next().expect("a row for each output")))
        .collect();
    rows.par_iter_mut().zip(kernel.par_chunks(inputs * TAPS)).for_each(|(points, taps)| {
        points_of_taps(taps, points);
    });
    points
}

/// The values of each point, which are `length` apart.
fn by_point(values: &mut [f32], length: usize) -> [&mut [f32]; POINTS] {
    let mut parts = values.chunks_exact_mut(length);
    std::array::from_fn(|_| parts.next().expect("values for each point"))
}
