//! The transforms between samples, taps or outputs and values at the points.

use super::super::vectorized::vectorized;
use super::{LANES, OUTPUTS, POINTS, TAPS};

/// A vector of the widest instruction set.
type Block = [f32; LANES];

/// Splits a block into four: every fourth number, beginning with each of the first four.
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

/// The inverse of [`apart`].
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

/// A block of numbers from `at` on, with zeros beyond the end.
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

/// Writes up to a block of numbers for each point.
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
    /// Transforms the `count` tiles of a padded series. The values of each point are written from
    /// `at` on.
    fn points_of_series(padded: &[f32], count: usize, at: usize, points: &mut [&mut [f32]]) {
        for first in (0..count).step_by(LANES) {
            let [x0, x1, x2, x3] = apart(&padded[OUTPUTS * first..][..OUTPUTS * LANES]);
            let [x4, x5, x6, x7] = apart(&padded[OUTPUTS * (first + 1)..][..OUTPUTS * LANES]);
            let mut values = [[0.0; LANES]; POINTS];
            for lane in 0..LANES {
                let [a, b, c, d] = [x0[lane], x1[lane], x2[lane], x3[lane]];
                let [e, f, g, h] = [x4[lane], x5[lane], x6[lane], x7[lane]];
                // A pair of points ±p shares the even and the odd part of the polynomial.
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
    /// Transforms the gradients of outputs in the same way.
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
    /// Transforms consecutive kernels.
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
    /// Transforms the products into outputs and adds `bias`.
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
    /// Transforms the gradients at the points into gradients of the taps.
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
