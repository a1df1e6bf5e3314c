//! `x Wᵀ + b` on the rows of slices, and its gradients, on all threads.

use std::cell::RefCell;
use std::mem::MaybeUninit;

use rayon::prelude::*;

use super::factors::Factors;
use super::panels::{Panels, multiples};
use super::parts::in_unwritten_parts;
use super::product::{Left, Offsets, Onto, Right, multiply};
use super::vectorized;

/// Elements of the left rows in a task: 128 KiB, which stay in a core's second-level cache beside
/// the right factor.
const TASK: usize = 32_768;

/// Multiplications below which a second thread does not pay.
const ALONE: usize = 1 << 21;

/// The rows of a task are a multiple of this, the rows of a register tile.
const TILE_ROWS: usize = 6;

/// Rows that are packed together when the product sums over rows: as many numbers of either kind.
const DEPTH: usize = 128;
const DEPTH_OF_PAIRS: usize = 256;

/// Padding between packed rows, in floats.
const APART: usize = 16;

/// y = x Wᵀ + b of a single row.
pub(super) fn row(x: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f32> {
    // Packing the weights would take longer than the product.
    let (rows, terms) = (multiples(bias.len(), x.len()), multiples(x.len(), 1));
    let left = Left { values: weight, rows: Offsets::of(&rows), step: 1 };
    let right = Right { values: x, terms: Offsets::of(&terms) };
    let mut y = vec![0.0; bias.len()];
    multiply(left, right, Onto::Rows(bias), &mut y, 1, 1);
    y
}

/// y = x Wᵀ + b. `weight` has the panels of Wᵀ, and y has `bias.len()` columns.
pub(super) fn forward(x: &[f32], input: usize, weight: &Panels, bias: &[f32]) -> Vec<f32> {
    let task = Task::of(x.len(), input, bias.len());
    task.results(
        || (),
        |(), index, y| task.product(task.part(x, index), weight, Onto::Columns(bias), y),
    )
}

/// y = f(x) Wᵀ + b. `f` maps some rows of x to as many rows, and gets the index of the first one.
pub(super) fn forward_of(
    f: impl Fn(&[f32], &mut [f32], usize) + Sync + Send,
    x: &[f32],
    input: usize,
    weight: &Panels,
    bias: &[f32],
) -> Vec<f32> {
    let task = Task::of(x.len(), input, bias.len());
    task.results(Vec::new, |scratch: &mut Vec<f32>, index, y| {
        let x = task.part(x, index);
        scratch.resize(x.len(), 0.0);
        f(x, scratch, index * task.rows);
        task.product(scratch, weight, Onto::Columns(bias), y)
    })
}

/// y = z + f(x) Wᵀ + b.
pub(super) fn forward_of_onto(
    f: impl Fn(&[f32], &mut [f32], usize) + Sync + Send,
    x: &[f32],
    input: usize,
    weight: &Panels,
    bias: &[f32],
    z: &[f32],
) -> Vec<f32> {
    let output = bias.len();
    let task = Task::of(x.len(), input, output);
    task.results(Vec::new, |scratch: &mut Vec<f32>, index, y| {
        let x = task.part(x, index);
        scratch.resize(x.len(), 0.0);
        f(x, scratch, index * task.rows);
        let z = &z[index * task.rows * output..][..y.len()];
        for (y, z) in y.chunks_mut(output).zip(z.chunks(output)) {
            for ((y, z), bias) in y.iter_mut().zip(z).zip(bias) {
                *y = MaybeUninit::new(z + bias);
            }
        }
        // SAFETY: z and the bias have a value for each of y.
        let y = unsafe { y.assume_init_mut() };
        weight.multiply(task.left(scratch), Onto::Output, y, output);
        y
    })
}

/// dx = dy W, where dy has `output` columns, and products read `factors`. `then` is called with some
/// rows of dx and the index of their first element.
pub(super) fn input_gradient(
    dy: &[f32],
    weight: &[f32],
    output: usize,
    factors: Factors,
    then: impl Fn(&mut [f32], usize) + Sync + Send,
) -> Vec<f32> {
    let input = weight.len() / output;
    let weight = Panels::of_rows(factors, weight, [output, input], input);
    let task = Task::of(dy.len(), output, input);
    task.results(
        || (),
        |(), index, dx| {
            let dx = task.product(task.part(dy, index), &weight, Onto::Nothing, dx);
            then(dx, index * task.rows * input);
            dx
        },
    )
}

/// The division of rows into tasks.
struct Task {
    rows: usize,
    depth: usize,
    /// Elements of a row of the results.
    output: usize,
    /// Number of all rows.
    length: usize,
    /// Offsets of the rows of a task.
    offsets: Vec<usize>,
}

impl Task {
    /// Divides rows of `depth` elements, `length` elements in all. Each becomes a row of `output`
    /// elements.
    fn of(length: usize, depth: usize, output: usize) -> Self {
        let all_rows = length / depth;
        let tasks = if length * output < ALONE { 1 } else { 2 * rayon::current_num_threads() };
        let fair = all_rows.div_ceil(tasks);
        let rows = (TASK / depth).min(fair).max(1).next_multiple_of(TILE_ROWS);
        Self { rows, depth, output, length: all_rows, offsets: multiples(rows, depth) }
    }

    /// The rows of all tasks. `write` computes those of each, as [`in_unwritten_parts`] says.
    fn results<S>(
        &self,
        scratch: impl Fn() -> S + Send + Sync,
        write: impl for<'a> Fn(&mut S, usize, &'a mut [MaybeUninit<f32>]) -> &'a mut [f32] + Send + Sync,
    ) -> Vec<f32> {
        let (length, part) = (self.length * self.output, self.rows * self.output);
        in_unwritten_parts(length, part, scratch, write)
    }

    /// Writes a product with the left rows of a task to all of `results`, and gives them.
    fn product<'a>(
        &self,
        left: &[f32],
        weight: &Panels,
        onto: Onto<'_>,
        results: &'a mut [MaybeUninit<f32>],
    ) -> &'a mut [f32] {
        let rows = results.len() / self.output;
        assert_eq!([left.len(), weight.columns()], [rows * self.depth, self.output]);
        weight.multiply(self.left(left), onto, results, self.output);
        // SAFETY: the product has these rows and columns, and it reads no results.
        unsafe { results.assume_init_mut() }
    }

    /// The left rows of a task.
    fn part<'a>(&self, values: &'a [f32], index: usize) -> &'a [f32] {
        let rest = &values[index * self.rows * self.depth..];
        &rest[..rest.len().min(self.rows * self.depth)]
    }

    fn left<'a>(&'a self, values: &'a [f32]) -> Left<'a> {
        let rows = Offsets::of(&self.offsets[..values.len() / self.depth]);
        Left { values, rows, step: 1 }
    }
}

/// Buffers of [`parameter_gradients`].
#[derive(Default)]
struct Scratch {
    /// Some rows of dy.
    values: Vec<f32>,
    /// As many rows of x.
    panels: Panels,
}

thread_local! {
    /// The buffers for the next call, which need no clearing then.
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// dW = dyᵀ x and db = Σ dy, in tasks of some rows of dW. x has `input` columns, and dy has `output`.
/// Products read `factors`.
pub(super) fn parameter_gradients(
    x: &[f32],
    dy: &[f32],
    [input, output]: [usize; 2],
    factors: Factors,
) -> [Vec<f32>; 2] {
    assert_eq!(x.len() * output, dy.len() * input, "x and dy have as many rows");
    let length = output * input;
    let mut d_bias = vec![0.0; output];
    if x.is_empty() {
        return [vec![0.0; length], d_bias];
    }
    let task = output.div_ceil(rayon::current_num_threads()).next_multiple_of(TILE_ROWS);
    let depth = match factors {
        Factors::F32 => DEPTH,
        Factors::Bf16 => DEPTH_OF_PAIRS,
    };
    let mut d_weight = Vec::with_capacity(length);
    let parts = d_weight.spare_capacity_mut()[..length].par_chunks_mut(task * input);
    parts.zip(d_bias.par_chunks_mut(task)).enumerate().for_each(|(index, (d_weight, d_bias))| {
        // The rows get another stride in the copy. With a stride of a power of two they would share
        // few sets of the first-level cache. The pairs of bf16 are such a copy, too.
        let (count, stride) = (d_bias.len(), d_bias.len() + APART);
        let columns = multiples(count, 1);
        let columns = Offsets::of(&columns);
        let mut scratch = SCRATCH.take();
        let Scratch { values, panels } = &mut scratch;
        panels.set_factors(factors);
        for (chunk, (x, dy)) in x.chunks(depth * input).zip(dy.chunks(depth * output)).enumerate() {
            panels.write_rows(x, [x.len() / input, input], input);
            let dy = &dy[index * task..];
            let left = match factors {
                Factors::F32 => {
                    values.resize(depth * stride, 0.0);
                    for (row, dy) in values.chunks_exact_mut(stride).zip(dy.chunks(output)) {
                        row[..count].copy_from_slice(&dy[..count]);
                    }
                    Left { values, rows: columns, step: stride }
                }
                Factors::Bf16 => Left { values: dy, rows: columns, step: output },
            };
            if chunk == 0 {
                panels.multiply(left, Onto::Nothing, d_weight, input);
            } else {
                // SAFETY: the first product has as many rows and columns.
                let d_weight = unsafe { d_weight.assume_init_mut() };
                panels.multiply(left, Onto::Output, d_weight, input);
            }
            vectorized::add_rows(dy, output, d_bias);
        }
        SCRATCH.set(scratch);
    });
    // SAFETY: the parts cover all weights, and there is a first product for each.
    unsafe { d_weight.set_len(length) };
    [d_weight, d_bias]
}
