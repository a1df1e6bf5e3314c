//! Softmax of rows and its backward pass, in the calling thread.

use std::f32::consts::LOG2_E;

use simd::{InstructionSet, Unfused, Vector};

use super::instruction_set::detected;

/// Softmax of `scale` times each row of `width` scores. Row r has `visible + r` visible scores, at
/// least one and at most all. The rest become 0.
pub(super) fn softmax(scores: &mut [f32], width: usize, scale: f32, visible: usize) {
    assert!(visible > 0);
    // SAFETY: the processor has the instructions.
    unsafe {
        match detected() {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => x86::avx512(scores, width, scale, visible),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => x86::avx2(scores, width, scale, visible),
            _ => all_rows::<Unfused>(scores, width, scale, visible),
        }
    }
}

/// Gradient of the scores, in place of the gradient of the probabilities: ds = scale · p (dp - Σ p
/// dp) for each row of `width`.
pub(super) fn softmax_gradient(p: &[f32], width: usize, scale: f32, gradient: &mut [f32]) {
    assert_eq!(p.len(), gradient.len());
    // SAFETY: the processor has the instructions.
    unsafe {
        match detected() {
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx512(_) => x86::avx512_gradient(p, width, scale, gradient),
            #[cfg(target_arch = "x86_64")]
            InstructionSet::Avx2(_) => x86::avx2_gradient(p, width, scale, gradient),
            _ => all_gradients::<Unfused>(p, width, scale, gradient),
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use simd::{F32x8, F32x16};

    use super::{all_gradients, all_rows};

    #[target_feature(enable = "avx512f")]
    pub unsafe fn avx512(scores: &mut [f32], width: usize, scale: f32, visible: usize) {
        // SAFETY: the processor has the instructions.
        unsafe { all_rows::<F32x16>(scores, width, scale, visible) };
    }

    #[target_feature(enable = "avx2,fma")]
    pub unsafe fn avx2(scores: &mut [f32], width: usize, scale: f32, visible: usize) {
        // SAFETY: the processor has the instructions.
        unsafe { all_rows::<F32x8>(scores, width, scale, visible) };
    }

    #[target_feature(enable = "avx512f")]
    pub unsafe fn avx512_gradient(p: &[f32], width: usize, scale: f32, gradient: &mut [f32]) {
        // SAFETY: the processor has the instructions.
        unsafe { all_gradients::<F32x16>(p, width, scale, gradient) };
    }

    #[target_feature(enable = "avx2,fma")]
    pub unsafe fn avx2_gradient(p: &[f32], width: usize, scale: f32, gradient: &mut [f32]) {
        // SAFETY: the processor has the instructions.
        unsafe { all_gradients::<F32x8>(p, width, scale, gradient) };
    }
}

// The following functions are unsafe because they use the vectors' instructions. They read and
// write whole vectors inside a slice, and the lanes of the last vector that lie inside.

/// Rows that go through each part of softmax together. A row waits for its greatest score and for
/// its sum. Meanwhile the processor computes the same part of the next rows, which are among the few
/// hundred instructions that it looks ahead.
const TOGETHER: usize = 8;

#[inline(always)]
unsafe fn all_rows<V: Vector>(scores: &mut [f32], width: usize, scale: f32, visible: usize) {
    for (index, rows) in scores.chunks_mut(TOGETHER * width).enumerate() {
        let visible = |row| visible.saturating_add(index * TOGETHER + row).min(width);
        let (mut greatest, mut sums) = ([0.0; TOGETHER], [0.0; TOGETHER]);
        // SAFETY: see above.
        unsafe {
            for (index, row) in rows.chunks_exact_mut(width).enumerate() {
                let (seen, hidden) = row.split_at_mut(visible(index));
                hidden.fill(0.0);
                greatest[index] = greatest_of::<V>(seen);
            }
            for (index, row) in rows.chunks_exact_mut(width).enumerate() {
                let seen = &mut row[..visible(index)];
                sums[index] = replace_by_powers::<V>(seen, greatest[index], scale);
            }
            for (index, row) in rows.chunks_exact_mut(width).enumerate() {
                multiply::<V>(&mut row[..visible(index)], 1.0 / sums[index]);
            }
        }
    }
}

#[inline(always)]
unsafe fn greatest_of<V: Vector>(row: &[f32]) -> f32 {
    let whole = row.len() / V::LANES * V::LANES;
    let from = row.as_ptr();
    // SAFETY: see above.
    unsafe {
        let none = V::splat(f32::NEG_INFINITY);
        let mut greatest = V::load_masked(from.add(whole), V::mask(row.len() - whole), none);
        for first in (0..whole).step_by(V::LANES) {
            greatest = greatest.max(V::load(from.add(first)));
        }
        greatest.greatest()
    }
}

/// Replaces each score by e^(`scale` (score - `greatest`)), and gives their sum.
#[inline(always)]
unsafe fn replace_by_powers<V: Vector>(row: &mut [f32], greatest: f32, scale: f32) -> f32 {
    let whole = row.len() / V::LANES * V::LANES;
    let to = row.as_mut_ptr();
    // SAFETY: see above.
    unsafe {
        let (scale, greatest) = (V::splat(scale), V::splat(greatest));
        let mut sums = V::splat(0.0);
        for first in (0..whole).step_by(V::LANES) {
            let power = exp(V::load(to.add(first)).sub(greatest).mul(scale));
            sums = sums.add(power);
            power.store(to.add(first));
        }
        let mut sum = sums.total();
        if whole < row.len() {
            let (tail, none) = (V::mask(row.len() - whole), V::splat(f32::NEG_INFINITY));
            let scores = V::load_masked(to.add(whole), tail, none);
            exp(scores.sub(greatest).mul(scale)).store_masked(to.add(whole), tail);
            for &power in row.get_unchecked(whole..) {
                sum += power;
            }
        }
        sum
    }
}

#[inline(always)]
unsafe fn multiply<V: Vector>(row: &mut [f32], factor: f32) {
    let whole = row.len() / V::LANES * V::LANES;
    let to = row.as_mut_ptr();
    // SAFETY: see above.
    unsafe {
        let factor = V::splat(factor);
        for first in (0..whole).step_by(V::LANES) {
            V::load(to.add(first)).mul(factor).store(to.add(first));
        }
        let (tail, zero) = (V::mask(row.len() - whole), V::splat(0.0));
        let rest = V::load_masked(to.add(whole), tail, zero);
        rest.mul(factor).store_masked(to.add(whole), tail);
    }
}

#[inline(always)]
unsafe fn all_gradients<V: Vector>(p: &[f32], width: usize, scale: f32, gradient: &mut [f32]) {
    let whole = width / V::LANES * V::LANES;
    for (p, gradient) in p.chunks_exact(width).zip(gradient.chunks_exact_mut(width)) {
        let (p, dp) = (p.as_ptr(), gradient.as_mut_ptr());
        // SAFETY: see above.
        unsafe {
            let (tail, zero) = (V::mask(width - whole), V::splat(0.0));
            let last = V::load_masked(p.add(whole), tail, zero);
            let mut sums = last.mul(V::load_masked(dp.add(whole), tail, zero));
            for first in (0..whole).step_by(V::LANES) {
                sums = V::load(p.add(first)).mul_add(V::load(dp.add(first)), sums);
            }
            let mean = V::splat(sums.total());
            let scale = V::splat(scale);
            for first in (0..whole).step_by(V::LANES) {
                let difference = V::load(dp.add(first)).sub(mean);
                V::load(p.add(first)).mul(scale).mul(difference).store(dp.add(first));
            }
            let difference = V::load_masked(dp.add(whole), tail, zero).sub(mean);
            last.mul(scale).mul(difference).store_masked(dp.add(whole), tail);
        }
    }
}

/// e^x to about a unit in the last place for x from -87 to 88, and e^-87 below.
///
/// The nearest power of two is split off, and a Taylor series computes the rest. To degree 6 its
/// error is below that of rounding for |rest| ≤ ½ ln 2.
#[inline(always)]
unsafe fn exp<V: Vector>(x: V) -> V {
    /// Adding this rounds to the nearest integer, which is then in the lowest bits.
    const ROUNDER: f32 = 12_582_912.0;
    /// ln 2 in two parts. The product of the first part with such an integer is exact.
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    /// 1 / n! from n = 6 to 0.
    const SERIES: [f32; 7] = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    // SAFETY: see above.
    unsafe {
        let x = V::splat(-87.0).max(x);
        let rounded = x.mul_add(V::splat(LOG2_E), V::splat(ROUNDER));
        let power = rounded.sub(V::splat(ROUNDER));
        let rest = power.mul_add(V::splat(-LN_2[0]), x);
        let rest = power.mul_add(V::splat(-LN_2[1]), rest);
        let mut series = V::splat(SERIES[0]);
        for &coefficient in &SERIES[1..] {
            series = series.mul_add(rest, V::splat(coefficient));
        }
        series.mul(rounded.power_of_two())
    }
}

#[cfg(test)]
mod tests {
    use super::super::instruction_set;
    use super::{softmax, softmax_gradient};

    #[test]
    fn softmax_is_exact_at_every_width_and_hides_the_future() {
        for width in 1..70 {
            instruction_set::tests::with_each(|set| {
                let scores: Vec<f32> =
                    (0..3 * width).map(|index| 20.0 * (index as f32 * 0.7).sin()).collect();
                let mut p = scores.clone();
                softmax(&mut p, width, 0.5, 2);
                for (row, (p, scores)) in p.chunks(width).zip(scores.chunks(width)).enumerate() {
                    let (seen, hidden) = p.split_at((2 + row).min(width));
                    assert!(hidden.iter().all(|&p| p == 0.0));
                    let powers = scores[..seen.len()].iter().map(|&x| (0.5 * f64::from(x)).exp());
                    let sum: f64 = powers.clone().sum();
                    for (&p, power) in seen.iter().zip(powers) {
                        let error = f64::from(p) * sum / power - 1.0;
                        assert!(error.abs() < 2e-6, "{set:?} {width}: {error:e}");
                    }
                }
            });
        }
    }

    /// All scores but the first are so small that their probabilities are 0.
    #[test]
    fn softmax_stands_extreme_scores() {
        instruction_set::tests::with_each(|set| {
            let mut p: Vec<f32> = [3e38, -3e38].into_iter().chain([-1e30; 30]).collect();
            softmax(&mut p, 32, 1.0, 32);
            assert_eq!(p[0], 1.0, "{set:?}");
            assert!(p[1..].iter().all(|&p| (0.0..1e-30).contains(&p)));
            let mut constant = vec![-7e4; 32];
            softmax(&mut constant, 32, 1.0, 32);
            assert!(constant.iter().all(|&p| (p - 1.0 / 32.0).abs() < 1e-8));
        });
    }

    #[test]
    fn gradients_of_rows_are_those_of_the_formula() {
        for width in 1..40 {
            instruction_set::tests::with_each(|set| {
                let p: Vec<f32> = (0..2 * width).map(|index| (index as f32).sin().abs()).collect();
                let dp: Vec<f32> = (0..2 * width).map(|index| (index as f32 * 1.3).cos()).collect();
                let mut ds = dp.clone();
                softmax_gradient(&p, width, 0.25, &mut ds);
                let rows = p.chunks(width).zip(dp.chunks(width));
                for ((p, dp), ds) in rows.zip(ds.chunks(width)) {
                    let mean: f64 = p.iter().zip(dp).map(|(&p, &dp)| f64::from(p * dp)).sum();
                    for ((&p, &dp), &ds) in p.iter().zip(dp).zip(ds) {
                        let exact = 0.25 * f64::from(p) * (f64::from(dp) - mean);
                        assert!((f64::from(ds) - exact).abs() < 1e-5, "{set:?} {width}");
                    }
                }
            });
        }
    }
}
