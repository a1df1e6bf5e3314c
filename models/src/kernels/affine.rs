//! `x Wᵀ + b` on the rows of slices, and its gradients, on all threads.

use rayon::prelude::*;

use super::panels::Panels;
use super::product::{Left, Onto, Right, multiply};
use super::vectorized;

/// Elements of the rows that a task multiplies: 128 KiB, which stay in a core's second-level cache
/// beside what they are multiplied with.
const TASK: usize = 32_768;

/// Rows of a task are a multiple of these, as of a tile's.
const TILE_ROWS: usize = 6;

/// Rows that are multiplied at once when rows are what is summed over.
const DEPTH: usize = 128;

/// y = x Wᵀ + b; y has `bias.len()` columns.
pub(super) fn forward(x: &[f32], weight: &[f32], bias: &[f32], y: &mut [f32]) {
    let output = bias.len();
    let input = weight.len() / output;
    if x.len() == input {
        // To rearrange the weights would take longer than to multiply them with one row.
        let rows: Vec<usize> = (0..output).map(|row| row * input).collect();
        let terms: Vec<usize> = (0..input).collect();
        let left = Left { values: weight, rows: &rows, step: 1 };
        return multiply(left, Right { values: x, terms: &terms }, Onto::Rows(bias), y, 1, 1);
    }
    let weight = Panels::of_columns(weight, input, output, input);
    times_panels(x, input, &weight, Onto::Columns(bias), y, output);
}

/// dx = dy W; dy has `output` columns.
pub(super) fn input_gradient(dy: &[f32], weight: &[f32], output: usize, dx: &mut [f32]) {
    let input = weight.len() / output;
    let weight = Panels::of_rows(weight, output, input, input);
    times_panels(dy, output, &weight, Onto::Nothing, dx, input);
}

/// The rows of x, `depth` long, times the panels, in tasks of some rows.
fn times_panels(
    x: &[f32],
    depth: usize,
    panels: &Panels,
    onto: Onto<'_>,
    y: &mut [f32],
    columns: usize,
) {
    let rows = x.len() / depth;
    let fair = rows.div_ceil(2 * rayon::current_num_threads());
    let task = (TASK / depth).min(fair).max(1).next_multiple_of(TILE_ROWS);
    let offsets: Vec<usize> = (0..task).map(|row| row * depth).collect();
    y.par_chunks_mut(task * columns).zip(x.par_chunks(task * depth)).for_each(|(y, x)| {
        let left = Left { values: x, rows: &offsets[..x.len() / depth], step: 1 };
        panels.multiply(left, onto, y, columns);
    });
}

/// dW = dyᵀ x and db = Σ dy, in tasks of some rows of dW.
pub(super) fn parameter_gradients(x: &[f32], dy: &[f32], d_weight: &mut [f32], d_bias: &mut [f32]) {
    let output = d_bias.len();
    let input = d_weight.len() / output;
    let task = output.div_ceil(rayon::current_num_threads()).next_multiple_of(TILE_ROWS);
    let parts = d_weight.par_chunks_mut(task * input).zip(d_bias.par_chunks_mut(task));
    parts.enumerate().for_each(|(index, (d_weight, d_bias))| {
        let columns: Vec<usize> = (0..d_bias.len()).map(|row| index * task + row).collect();
        let mut panels = Panels::default();
        let mut onto = Onto::Nothing;
        for (x, dy) in x.chunks(DEPTH * input).zip(dy.chunks(DEPTH * output)) {
            panels.write_rows(x, x.len() / input, input, input);
            let left = Left { values: dy, rows: &columns, step: output };
            panels.multiply(left, onto, d_weight, input);
            onto = Onto::Output;
            vectorized::add_rows(&dy[index * task..], output, d_bias);
        }
    });
}
