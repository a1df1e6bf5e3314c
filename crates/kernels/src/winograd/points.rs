//! The transforms between samples, taps or outputs and values at the points.

use simd::{InstructionSet, Unfused, Vector};

use super::super::instruction_set::detected;
use super::{OUTPUTS, POINTS, TAPS};

/// Defines a function that calls a generic one with the widest vectors of the processor.
macro_rules! on_vectors {
    ($(#[$attribute:meta])* fn $name:ident($($argument:ident: $type:ty),* $(,)?) = $generic:ident) => {
        $(#[$attribute])*
        pub(super) fn $name($($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f")]
            fn avx512($($argument: $type),*) {
                // SAFETY: this function is compiled for the vectors' instructions.
                unsafe { $generic::<simd::F32x16>($($argument),*) }
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($argument: $type),*) {
                // SAFETY: see above.
                unsafe { $generic::<simd::F32x8>($($argument),*) }
            }

            match detected() {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the processor has these instructions.
                InstructionSet::Avx512(_) => unsafe { avx512($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: the processor has these instructions.
                InstructionSet::Avx2(_) => unsafe { avx2($($argument),*) },
                // SAFETY: these vectors need no instructions.
                InstructionSet::Portable => unsafe { $generic::<Unfused>($($argument),*) },
            }
        }
    };
}

on_vectors! {
    /// Transforms the `count` tiles of a series, whose first one begins at sample `start`. There are
    /// zeros beyond the ends of the series. The values of each point are written from `at` on.
    /// Up to a vector of meaningless numbers follows them, where there is room.
    fn points_of_series(
        series: &[f32],
        start: isize,
        count: usize,
        at: usize,
        points: &mut [&mut [f32]; POINTS],
    ) = series_at_points
}

on_vectors! {
    /// Transforms the gradients of outputs in the same way.
    fn points_of_outputs(gradients: &[f32], at: usize, points: &mut [&mut [f32]; POINTS]) =
        outputs_at_points
}

on_vectors! {
    /// Transforms consecutive kernels.
    fn points_of_taps(taps: &[f32], points: &mut [&mut [f32]; POINTS]) = taps_at_points
}

on_vectors! {
    /// Transforms the products into outputs and adds `bias`. Products beyond the last tile are
    /// ignored.
    fn outputs_of_products(products: [&[f32]; POINTS], bias: f32, outputs: &mut [f32]) =
        outputs_of
}

on_vectors! {
    /// Transforms the gradients at the points into gradients of the taps.
    fn taps_of_points(points: [&[f32]; POINTS], taps: &mut [&mut [f32]; TAPS]) = taps_of
}

// Each function below must be inlined into one that is compiled for the instructions of its
// vectors, and that runs on a processor with them.

#[inline(always)]
unsafe fn series_at_points<V: Vector>(
    series: &[f32],
    start: isize,
    count: usize,
    at: usize,
    points: &mut [&mut [f32]; POINTS],
) {
    // SAFETY: here and below, the caller guarantees the instructions.
    unsafe {
        let times = |factor: f32, vector: V| V::splat(factor) * vector;
        let mut tiles = tiles_at::<V>(series, start);
        for first in (0..count).step_by(V::LANES) {
            let next = (OUTPUTS * (first + V::LANES)).cast_signed();
            let next = tiles_at::<V>(series, start + next);
            let [a, b, c, d] = tiles;
            // A tile sees the next one's samples, too.
            let [e, f] = [a.shifted(next[0]), b.shifted(next[1])];
            let [g, h] = [c.shifted(next[2]), d.shifted(next[3])];
            tiles = next;

            // A pair of points ±p shares the even and the odd part of the polynomial.
            let ones = (c + g - times(4.25, e), b + f - times(4.25, d));
            let halves =
                (times(4.0, c) + g - times(5.0, e), times(2.0, b) + times(0.5, f) - times(2.5, d));
            let twos = (
                times(0.25, c) + g - times(1.25, e),
                times(0.5, b) + times(2.0, f) - times(2.5, d),
            );
            let zero = g - a + times(5.25, c - e);
            let infinity = h - b + times(5.25, d - f);
            put(zero, [ones, halves, twos], infinity, at + first, points);
        }
    }
}

#[inline(always)]
unsafe fn outputs_at_points<V: Vector>(
    gradients: &[f32],
    at: usize,
    points: &mut [&mut [f32]; POINTS],
) {
    // SAFETY: see above.
    unsafe {
        let times = |factor: f32, vector: V| V::splat(factor) * vector;
        for first in (0..gradients.len().div_ceil(OUTPUTS)).step_by(V::LANES) {
            let [a, b, c, d] = tiles_at::<V>(gradients, (OUTPUTS * first).cast_signed());
            let ones = (a + c, b + d);
            let halves = (a + times(0.25, c), times(0.5, b) + times(0.125, d));
            let twos = (a + times(4.0, c), times(2.0, b) + times(8.0, d));
            put(a, [ones, halves, twos], d, at + first, points);
        }
    }
}

#[inline(always)]
unsafe fn taps_at_points<V: Vector>(taps: &[f32], points: &mut [&mut [f32]; POINTS]) {
    // SAFETY: see above.
    unsafe {
        let times = |factor: f32, vector: V| V::splat(factor) * vector;
        let (kernels, _) = taps.as_chunks::<TAPS>();
        for (block, kernels) in kernels.chunks(V::LANES).enumerate() {
            let mut taps = [[0.0; MOST_LANES]; TAPS];
            for (lane, kernel) in kernels.iter().enumerate() {
                for tap in 0..TAPS {
                    taps[tap][lane] = kernel[tap];
                }
            }
            let [a, b, c, d, e] = vectors(&taps.each_ref().map(|taps| &taps[..]), 0);
            let ones = (times(-2.0 / 9.0, a + c + e), times(-2.0 / 9.0, b + d));
            let halves = (
                times(2.0 / 45.0, times(16.0, a) + times(4.0, c) + e),
                times(2.0 / 45.0, times(8.0, b) + times(2.0, d)),
            );
            let twos = (
                times(1.0 / 90.0, a + times(4.0, c) + times(16.0, e)),
                times(1.0 / 90.0, times(2.0, b) + times(8.0, d)),
            );
            put(times(-1.0, a), [ones, halves, twos], e, V::LANES * block, points);
        }
    }
}

#[inline(always)]
unsafe fn outputs_of<V: Vector>(products: [&[f32]; POINTS], bias: f32, outputs: &mut [f32]) {
    // SAFETY: see above.
    unsafe {
        let times = |factor: f32, vector: V| V::splat(factor) * vector;
        let bias = V::splat(bias);
        for first in (0..outputs.len().div_ceil(OUTPUTS)).step_by(V::LANES) {
            let [zero, a, b, c, d, e, f, infinity] = vectors::<V, POINTS>(&products, first);
            let (one, half, two) = (a + b, c + d, e + f);
            let y0 = zero + bias + one + half + two;
            let y2 = bias + one + times(0.25, half) + times(4.0, two);
            let (one, half, two) = (a - b, c - d, e - f);
            let y1 = bias + one + times(0.5, half) + times(2.0, two);
            let y3 = infinity + bias + one + times(0.125, half) + times(8.0, two);
            // The inverse of `tiles_at`.
            let ([even, odd], [other_even, other_odd]) = (y0.interleave(y2), y1.interleave(y3));
            let (first_half, second_half) =
                (even.interleave(other_even), odd.interleave(other_odd));
            let all = first_half.into_iter().chain(second_half);
            for (index, vector) in all.enumerate() {
                store_at(vector, outputs, OUTPUTS * first + index * V::LANES);
            }
        }
    }
}

#[inline(always)]
unsafe fn taps_of<V: Vector>(points: [&[f32]; POINTS], taps: &mut [&mut [f32]; TAPS]) {
    // SAFETY: see above.
    unsafe {
        let times = |factor: f32, vector: V| V::splat(factor) * vector;
        for first in (0..taps[0].len()).step_by(V::LANES) {
            let [zero, a, b, c, d, e, f, infinity] = vectors::<V, POINTS>(&points, first);
            let one = times(-2.0 / 9.0, a + b);
            let half = times(2.0 / 45.0, c + d);
            let two = times(1.0 / 90.0, e + f);
            store_at(one + times(16.0, half) + two - zero, taps[0], first);
            store_at(one + times(4.0, half) + times(4.0, two), taps[2], first);
            store_at(one + half + times(16.0, two) + infinity, taps[4], first);
            let one = times(-2.0 / 9.0, a - b);
            let half = times(2.0 / 45.0, c - d);
            let two = times(1.0 / 90.0, e - f);
            store_at(one + times(8.0, half) + times(2.0, two), taps[1], first);
            store_at(one + times(2.0, half) + times(8.0, two), taps[3], first);
        }
    }
}

/// [`Vector::LANES`] is at most this.
const MOST_LANES: usize = 16;

/// Writes the values at 0, at ±1, ±1/2 and ±2 from their even and odd parts, and at ∞.
#[inline(always)]
unsafe fn put<V: Vector>(
    zero: V,
    parts: [(V, V); 3],
    infinity: V,
    at: usize,
    points: &mut [&mut [f32]; POINTS],
) {
    // SAFETY: see above.
    unsafe {
        store_at(zero, points[0], at);
        for (index, (even, odd)) in parts.into_iter().enumerate() {
            store_at(even + odd, points[1 + 2 * index], at);
            store_at(even - odd, points[2 + 2 * index], at);
        }
        store_at(infinity, points[POINTS - 1], at);
    }
}

/// Every fourth sample from `start` on, and the same from each of the next three on: a tile in each
/// lane. There are zeros beyond the ends of the series.
#[inline(always)]
unsafe fn tiles_at<V: Vector>(series: &[f32], start: isize) -> [V; OUTPUTS] {
    // SAFETY: see above.
    unsafe {
        let mut samples = [V::splat(0.0); OUTPUTS];
        for (index, vector) in samples.iter_mut().enumerate() {
            *vector = samples_at(series, start + (index * V::LANES).cast_signed());
        }
        let [even, odd] = samples[0].deinterleave(samples[1]);
        let [next_even, next_odd] = samples[2].deinterleave(samples[3]);
        let ([first, third], [second, fourth]) =
            (even.deinterleave(next_even), odd.deinterleave(next_odd));
        [first, second, third, fourth]
    }
}

#[inline(always)]
unsafe fn samples_at<V: Vector>(series: &[f32], start: isize) -> V {
    // SAFETY: see above. The array has room for a vector.
    unsafe {
        if start >= 0 {
            return load_at(series, start.unsigned_abs());
        }
        let mut samples = [0.0; MOST_LANES];
        let before = start.unsigned_abs().min(V::LANES);
        for (place, &sample) in samples[before..V::LANES].iter_mut().zip(series) {
            *place = sample;
        }
        V::load(samples.as_ptr())
    }
}

/// A vector of each, from `at` on.
#[inline(always)]
unsafe fn vectors<V: Vector, const N: usize>(values: &[&[f32]; N], at: usize) -> [V; N] {
    // SAFETY: see above.
    unsafe {
        let mut vectors = [V::splat(0.0); N];
        for (vector, values) in vectors.iter_mut().zip(values) {
            *vector = load_at(values, at);
        }
        vectors
    }
}

/// A vector from `at` on, with zeros beyond the end.
#[inline(always)]
unsafe fn load_at<V: Vector>(values: &[f32], at: usize) -> V {
    let values = &values[at.min(values.len())..];
    // SAFETY: see above. Only values are read.
    unsafe {
        if values.len() >= V::LANES {
            V::load(values.as_ptr())
        } else {
            V::load_masked(values.as_ptr(), V::mask(values.len()), V::splat(0.0))
        }
    }
}

/// Writes a vector from `at` on, or as many of its lanes as have room.
#[inline(always)]
unsafe fn store_at<V: Vector>(vector: V, to: &mut [f32], at: usize) {
    let at = at.min(to.len());
    let to = &mut to[at..];
    // SAFETY: see above. Only the places are written.
    unsafe {
        if to.len() >= V::LANES {
            vector.store(to.as_mut_ptr());
        } else {
            vector.store_masked(to.as_mut_ptr(), V::mask(to.len()));
        }
    }
}
