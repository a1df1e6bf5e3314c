//! Loops over rows of floats, compiled for the widest vectors that the processor has.
//!
//! Sums use [`LANES`] partial sums for every vector width. With either set of vector instructions,
//! products are added without rounding in between.

mod functions;

use std::mem::MaybeUninit;

use super::adam_w_step::Constants;
use functions::{
    exponential, mish_and_slope, mish_of, mish_slope, multiply_add, normal_distribution,
};

const LANES: usize = 16;

/// Defines a function that is compiled for several instruction sets. Each call chooses the best
/// one. The rest of the program is compiled for the baseline of x86-64, whose vectors are a quarter
/// as wide.
macro_rules! vectorized {
    ($(#[$attribute:meta])* fn $name:ident($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$attribute])*
        pub(super) fn $name($($argument: $type),*) {
            #[inline(always)]
            fn portable<const FUSED: bool>($($argument: $type),*) $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f")]
                fn avx512($($argument: $type),*) { portable::<true>($($argument),*) }

                #[target_feature(enable = "avx2,fma")]
                fn avx2($($argument: $type),*) { portable::<true>($($argument),*) }

                match $crate::instruction_set::detected() {
                    // SAFETY: the processor has these instructions.
                    simd::InstructionSet::Avx512(_) => return unsafe { avx512($($argument),*) },
                    // SAFETY: the processor has these instructions.
                    simd::InstructionSet::Avx2(_) => return unsafe { avx2($($argument),*) },
                    simd::InstructionSet::Portable => {}
                }
            }
            portable::<false>($($argument),*)
        }
    };
}

pub(super) use vectorized;

vectorized! {
    /// y = x Φ(x).
    fn gelu(x: &[f32], y: &mut [f32]) {
        for (y, &x) in y.iter_mut().zip(x) {
            let (cumulative, _) = normal_distribution::<FUSED>(x);
            *y = x * cumulative;
        }
    }
}

vectorized! {
    /// y = x Φ(x) and its derivative Φ(x) + x φ(x).
    fn gelu_and_slope(x: &[f32], y: &mut [MaybeUninit<f32>], slope: &mut [MaybeUninit<f32>]) {
        for ((y, slope), &x) in y.iter_mut().zip(slope).zip(x) {
            let (cumulative, density) = normal_distribution::<FUSED>(x);
            *y = MaybeUninit::new(x * cumulative);
            *slope = MaybeUninit::new(cumulative + x * density);
        }
    }
}

vectorized! {
    /// Raises `greatest` to the largest of `offsets`.
    fn furthest(offsets: &[usize], greatest: &mut usize) {
        let mut lanes = [*greatest; LANES];
        let (blocks, rest) = offsets.as_chunks::<LANES>();
        for block in blocks {
            for lane in 0..LANES {
                lanes[lane] = lanes[lane].max(block[lane]);
            }
        }
        *greatest = lanes.iter().chain(rest).fold(*greatest, |a, &b| a.max(b));
    }
}

vectorized! {
    /// x = x factors.
    fn multiply(x: &mut [f32], factors: &[f32]) {
        for (x, &factor) in x.iter_mut().zip(factors) {
            *x *= factor;
        }
    }
}

vectorized! {
    /// y = x tanh(ln(1 + eˣ)).
    fn mish(x: &[f32], y: &mut [f32]) {
        for (y, &x) in y.iter_mut().zip(x) {
            *y = mish_of::<FUSED>(x);
        }
    }
}

vectorized! {
    /// dx = mish'(x) dy.
    fn mish_gradient(x: &[f32], dy: &[f32], dx: &mut [f32]) {
        for ((dx, &x), &dy) in dx.iter_mut().zip(x).zip(dy) {
            *dx = mish_slope::<FUSED>(x) * dy;
        }
    }
}

vectorized! {
    /// y = tanh x.
    fn tanh(x: &[f32], y: &mut [f32]) {
        for (y, &x) in y.iter_mut().zip(x) {
            *y = 1.0 - 2.0 / (exponential::<FUSED>(2.0 * x) + 1.0);
        }
    }
}

vectorized! {
    /// dx = (1 - tanh² x) dy. A different formula avoids the difference, which would lose the
    /// tails.
    fn tanh_gradient(x: &[f32], dy: &[f32], dx: &mut [f32]) {
        for ((dx, &x), &dy) in dx.iter_mut().zip(x).zip(dy) {
            // The slope is even in x. With the negative exponent, the square of the power stays
            // finite.
            let power = exponential::<FUSED>(-2.0 * x.abs());
            *dx = 4.0 * power / ((power + 1.0) * (power + 1.0)) * dy;
        }
    }
}

vectorized! {
    /// y = mish(x̂ weight + bias) with x̂ = (x - mean) / deviation over all of x. x has as many
    /// channels of equal length as `weight` has values.
    fn group_norm_mish(x: &[f32], weight: &[f32], bias: &[f32], epsilon: f32, y: &mut [f32]) {
        let samples = x.len() / weight.len();
        let (mean, inverse_deviation) = moments::<FUSED>(x, epsilon);
        let channels = x.chunks_exact(samples).zip(y.chunks_exact_mut(samples));
        for ((x, y), (&weight, &bias)) in channels.zip(weight.iter().zip(bias)) {
            for (y, &x) in y.iter_mut().zip(x) {
                *y = mish_of::<FUSED>((x - mean) * inverse_deviation * weight + bias);
            }
        }
    }
}

/// Gradients of numbers that a channel has, each the sum over its samples.
pub(super) struct ChannelGradients<'a> {
    pub weight: &'a mut [f32],
    pub bias: &'a mut [f32],
    /// Empty if there is no factor.
    pub scale: &'a mut [f32],
    pub shift: &'a mut [f32],
}

vectorized! {
    /// The gradients of y = scale mish(z) + shift with z = x̂ weight + bias, where `scale` may be
    /// empty. With dz = scale mish'(z) dy and h = dz weight:
    /// dx = (h - mean(h) - x̂ mean(h x̂)) / deviation.
    fn group_norm_mish_gradient(
        x: &[f32],
        weight_and_bias: [&[f32]; 2],
        scale: &[f32],
        epsilon: f32,
        dy: &[f32],
        dx: &mut [f32],
        gradients: ChannelGradients<'_>,
    ) {
        let [weight, bias] = weight_and_bias;
        let samples = x.len() / weight.len();
        let (mean, inverse_deviation) = moments::<FUSED>(x, epsilon);
        let (mut sum_h, mut sum_hx) = (0.0, 0.0);
        for channel in 0..weight.len() {
            let range = channel * samples..(channel + 1) * samples;
            let (x, dy, dx) = (&x[range.clone()], &dy[range.clone()], &mut dx[range]);
            let (weight, bias) = (weight[channel], bias[channel]);
            let z = |x: f32| (x - mean) * inverse_deviation * weight + bias;
            if let Some(&scale) = scale.get(channel) {
                gradients.scale[channel] = scaled_mish_gradient::<FUSED>(z, x, scale, dy, dx);
            } else {
                for ((dz, &x), &dy) in dx.iter_mut().zip(x).zip(dy) {
                    *dz = mish_slope::<FUSED>(z(x)) * dy;
                }
            }
            let d_weight = sum_of_products::<FUSED>(dx, x, mean) * inverse_deviation;
            let d_bias = sum(dx);
            gradients.weight[channel] = d_weight;
            gradients.bias[channel] = d_bias;
            gradients.shift[channel] = sum(dy);
            sum_h += d_bias * weight;
            sum_hx += d_weight * weight;
        }
        let (mean_h, mean_hx) = (sum_h / x.len() as f32, sum_hx / x.len() as f32);
        for ((x, dx), &weight) in
            x.chunks_exact(samples).zip(dx.chunks_exact_mut(samples)).zip(weight)
        {
            for (dx, &x) in dx.iter_mut().zip(x) {
                let normal = (x - mean) * inverse_deviation;
                *dx = (*dx * weight - mean_h - normal * mean_hx) * inverse_deviation;
            }
        }
    }
}

vectorized! {
    /// Each row of `weight.len()` elements: y = x̂ weight + bias with x̂ = (x - mean) / deviation.
    fn layer_norm(x: &[f32], weight: &[f32], bias: &[f32], epsilon: f32, y: &mut [f32]) {
        let width = weight.len();
        for (x, y) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)) {
            let (mean, inverse_deviation) = moments::<FUSED>(x, epsilon);
            for (((y, &x), &weight), &bias) in y.iter_mut().zip(x).zip(weight).zip(bias) {
                *y = (x - mean) * inverse_deviation * weight + bias;
            }
        }
    }
}

vectorized! {
    /// With h = dy · weight: dx = (h - mean(h) - x̂ mean(h x̂)) / deviation for each row. Adds
    /// dy x̂ to `d_weight` and dy to `d_bias`.
    fn layer_norm_gradient(
        x: &[f32],
        weight: &[f32],
        epsilon: f32,
        dy: &[f32],
        dx: &mut [f32],
        sums: [&mut [f32]; 2],
    ) {
        let [d_weight, d_bias] = sums;
        let width = weight.len();
        let rows = x.chunks_exact(width).zip(dy.chunks_exact(width));
        for ((x, dy), dx) in rows.zip(dx.chunks_exact_mut(width)) {
            let (mean, inverse_deviation) = moments::<FUSED>(x, epsilon);
            for ((dx, &dy), &weight) in dx.iter_mut().zip(dy).zip(weight) {
                *dx = dy * weight;
            }
            let mean_h = sum(dx) / width as f32;
            for (((d_weight, d_bias), &x), &dy) in
                d_weight.iter_mut().zip(d_bias.iter_mut()).zip(x).zip(dy)
            {
                *d_weight += dy * ((x - mean) * inverse_deviation);
                *d_bias += dy;
            }
            let mean_hx = sum_of_products::<FUSED>(dx, x, mean) * inverse_deviation / width as f32;
            for (dx, &x) in dx.iter_mut().zip(x) {
                let normal = (x - mean) * inverse_deviation;
                *dx = (*dx - mean_h - normal * mean_hx) * inverse_deviation;
            }
        }
    }
}

vectorized! {
    /// m = β₁ m + (1 - β₁) g, v = β₂ v + (1 - β₂) g², w = keep w - rate m / (√(corrected v) + ε).
    fn adam_w(
        weight: &mut [f32],
        gradient: &[f32],
        first: &mut [f32],
        second: &mut [f32],
        step: &Constants,
    ) {
        let [beta_1, beta_2] = step.betas;
        let moments = first.iter_mut().zip(second.iter_mut());
        for ((weight, &gradient), (first, second)) in weight.iter_mut().zip(gradient).zip(moments) {
            let gradient = step.scale * gradient;
            *first = *first * beta_1 + gradient * (1.0 - beta_1);
            *second = *second * beta_2 + gradient * gradient * (1.0 - beta_2);
            let deviation = (*second * step.second_correction).sqrt() + step.epsilon;
            *weight = *weight * step.keep - step.rate * *first / deviation;
        }
    }
}

vectorized! {
    /// Sum of each row of `width` elements.
    fn row_sums(rows: &[f32], width: usize, sums: &mut [f32]) {
        for (total, row) in sums.iter_mut().zip(rows.chunks_exact(width)) {
            *total = sum(row);
        }
    }
}

vectorized! {
    /// Multiplies each row of `width` elements by its factor.
    fn multiply_rows(rows: &mut [f32], width: usize, factors: &[f32]) {
        for (row, factor) in rows.chunks_exact_mut(width).zip(factors) {
            for value in row {
                *value *= factor;
            }
        }
    }
}

vectorized! {
    /// Adds its term to each row of `width` elements.
    fn add_to_rows(rows: &mut [f32], width: usize, terms: &[f32]) {
        for (row, term) in rows.chunks_exact_mut(width).zip(terms) {
            for value in row {
                *value += term;
            }
        }
    }
}

vectorized! {
    /// total += each row of `total.len()` elements that begin `stride` apart.
    fn add_rows(rows: &[f32], stride: usize, total: &mut [f32]) {
        for row in rows.chunks(stride) {
            for (total, &value) in total.iter_mut().zip(row) {
                *total += value;
            }
        }
    }
}

/// Mean, and 1 / √(variance + ε), of a row.
#[inline(always)]
fn moments<const FUSED: bool>(x: &[f32], epsilon: f32) -> (f32, f32) {
    let mean = sum(x) / x.len() as f32;
    let mut lanes = [0.0; LANES];
    let (blocks, rest) = x.as_chunks::<LANES>();
    for block in blocks {
        for lane in 0..LANES {
            let distance = block[lane] - mean;
            lanes[lane] = multiply_add::<FUSED>(distance, distance, lanes[lane]);
        }
    }
    let mut squares = add_lanes(lanes);
    for &x in rest {
        squares += (x - mean) * (x - mean);
    }
    (mean, 1.0 / (squares / x.len() as f32 + epsilon).sqrt())
}

#[inline(always)]
fn sum(x: &[f32]) -> f32 {
    let mut lanes = [0.0; LANES];
    let (blocks, rest) = x.as_chunks::<LANES>();
    for block in blocks {
        for lane in 0..LANES {
            lanes[lane] += block[lane];
        }
    }
    let mut total = add_lanes(lanes);
    for &x in rest {
        total += x;
    }
    total
}

/// Σ a (b - offset).
#[inline(always)]
fn sum_of_products<const FUSED: bool>(a: &[f32], b: &[f32], offset: f32) -> f32 {
    let mut lanes = [0.0; LANES];
    let (a_blocks, a_rest) = a.as_chunks::<LANES>();
    let (b_blocks, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a_blocks.iter().zip(b_blocks) {
        for lane in 0..LANES {
            lanes[lane] = multiply_add::<FUSED>(a[lane], b[lane] - offset, lanes[lane]);
        }
    }
    let mut total = add_lanes(lanes);
    for (&a, &b) in a_rest.iter().zip(b_rest) {
        total += a * (b - offset);
    }
    total
}

/// Adds halves first, because a sum of one lane after the other would wait for each addition.
#[inline(always)]
fn add_lanes(mut lanes: [f32; LANES]) -> f32 {
    let mut count = LANES;
    while count > 1 {
        count /= 2;
        for lane in 0..count {
            lanes[lane] += lanes[lane + count];
        }
    }
    lanes[0]
}

/// dz = scale mish'(z) dy of a channel, with z a function of x. Gives Σ mish(z) dy.
#[inline(always)]
fn scaled_mish_gradient<const FUSED: bool>(
    z: impl Fn(f32) -> f32,
    x: &[f32],
    scale: f32,
    dy: &[f32],
    dz: &mut [f32],
) -> f32 {
    let mut lanes = [0.0; LANES];
    let (x_blocks, x_rest) = x.as_chunks::<LANES>();
    let (dy_blocks, dy_rest) = dy.as_chunks::<LANES>();
    let (dz_blocks, dz_rest) = dz.as_chunks_mut::<LANES>();
    for ((x, dy), dz) in x_blocks.iter().zip(dy_blocks).zip(dz_blocks) {
        for lane in 0..LANES {
            let (value, slope) = mish_and_slope::<FUSED>(z(x[lane]));
            dz[lane] = scale * slope * dy[lane];
            lanes[lane] = multiply_add::<FUSED>(value, dy[lane], lanes[lane]);
        }
    }
    let mut total = add_lanes(lanes);
    for ((&x, &dy), dz) in x_rest.iter().zip(dy_rest).zip(dz_rest) {
        let (value, slope) = mish_and_slope::<FUSED>(z(x));
        *dz = scale * slope * dy;
        total += value * dy;
    }
    total
}
