//! Functions of one number. Loops inline them, so that the compiler makes vectors of them.
//!
//! With `FUSED`, the instructions include a fused multiply-add.

/// (Φ(x), φ(x)) of the standard normal distribution. Φ is formula 7.1.26 of Abramowitz and Stegun,
/// with an absolute error below 7.5e-8. Nothing cancels in the left tail.
#[inline(always)]
pub(super) fn normal_distribution<const FUSED: bool>(x: f32) -> (f32, f32) {
    const INVERSE_ROOT_TAU: f32 = 0.398_942_3;
    let bell = exponential::<FUSED>(-0.5 * x * x);
    let t = 1.0 / (1.0 + 0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2 * x.abs());
    let mut polynomial = 1.061_405_4;
    for coefficient in [-1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6] {
        polynomial = multiply_add::<FUSED>(polynomial, t, coefficient);
    }
    let tail = 0.5 * polynomial * t * bell;
    let cumulative = if x < 0.0 { tail } else { 1.0 - tail };
    (cumulative, INVERSE_ROOT_TAU * bell)
}

/// Above this, tanh(ln(1 + eˣ)) is 1 and x is Mish. The square of eˣ is still finite.
const MISH_IS_LINEAR: f32 = 20.0;

/// Below this, x eˣ and Mish are 0 in single precision.
const MISH_IS_ZERO: f32 = -87.0;

/// With n = eˣ (eˣ + 2), tanh(ln(1 + eˣ)) is n / (n + 2): nothing cancels in either tail.
#[inline(always)]
pub(super) fn mish_of<const FUSED: bool>(x: f32) -> f32 {
    let power = exponential::<FUSED>(x.clamp(MISH_IS_ZERO, MISH_IS_LINEAR));
    let n = power * (power + 2.0);
    x.clamp(MISH_IS_ZERO, f32::INFINITY) * (n / (n + 2.0))
}

/// d/dx mish.
#[inline(always)]
pub(super) fn mish_slope<const FUSED: bool>(x: f32) -> f32 {
    let (_, slope) = mish_and_slope::<FUSED>(x);
    slope
}

/// Mish and d/dx mish = n / (n + 2) + 4 x eˣ (1 + eˣ) / (n + 2)².
#[inline(always)]
pub(super) fn mish_and_slope<const FUSED: bool>(x: f32) -> (f32, f32) {
    let within = x.clamp(MISH_IS_ZERO, MISH_IS_LINEAR);
    let power = exponential::<FUSED>(within);
    let n = power * (power + 2.0);
    let inverse = 1.0 / (n + 2.0);
    let slope = inverse * (n + 4.0 * within * power * (1.0 + power) * inverse);
    (x.clamp(MISH_IS_ZERO, f32::INFINITY) * (n * inverse), slope)
}

/// a b + c, rounded once if `FUSED`. Without the instruction a fused sum would be slow.
#[inline(always)]
pub(super) fn multiply_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// eˣ within 2 units in the last place for -87 ≤ x ≤ 88, and e⁻⁸⁷ below (Cephes' `expf`).
#[inline(always)]
pub(super) fn exponential<const FUSED: bool>(x: f32) -> f32 {
    /// Adding this rounds to the nearest integer, which is then in the lowest bits.
    const ROUNDER: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 88.0);
    let rounded = multiply_add::<FUSED>(x, std::f32::consts::LOG2_E, ROUNDER);
    let power = rounded - ROUNDER;
    // ln 2 in two parts. The product of the first part with such an integer is exact.
    let rest = multiply_add::<FUSED>(power, -0.693_359_4, x);
    let rest = multiply_add::<FUSED>(power, 2.121_944_4e-4, rest);
    let mut polynomial = 1.987_569_1e-4;
    for coefficient in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 0.166_666_65, 0.5] {
        polynomial = multiply_add::<FUSED>(polynomial, rest, coefficient);
    }
    let fraction = multiply_add::<FUSED>(polynomial * rest, rest, rest) + 1.0;
    let exponent = rounded.to_bits().wrapping_sub(ROUNDER.to_bits()).wrapping_add(127);
    fraction * f32::from_bits(exponent << 23)
}

#[cfg(test)]
mod tests {
    use super::{exponential, normal_distribution};

    #[test]
    fn the_exponential_is_exact_to_two_units_in_the_last_place() {
        for step in 0..200_000 {
            let x = -87.0 + step as f32 * (175.0 / 200_000.0);
            let exact = f64::from(x).exp();
            let error = (f64::from(exponential::<true>(x)) - exact).abs() / exact;
            assert!(error < 2.4e-7, "{x}: {error:e}");
        }
        assert!(exponential::<true>(-1e30) < 2e-38);
        assert_eq!(exponential::<true>(0.0), 1.0);
    }

    /// Compares Φ with a published table (Abramowitz and Stegun, table 26.1).
    #[test]
    fn the_normal_distribution_is_the_tabled_one() {
        for (x, cumulative) in [
            (0.0, 0.5),
            (0.5, 0.691_462_461_274),
            (1.0, 0.841_344_746_069),
            (2.0, 0.977_249_868_052),
            (-1.0, 0.158_655_253_931),
            (-3.0, 0.001_349_898_032),
        ] {
            let (found, _) = normal_distribution::<true>(x);
            assert!((f64::from(found) - cumulative).abs() < 1.5e-7, "{x}: {found}");
        }
        let (_, density) = normal_distribution::<true>(1.0);
        assert!((density - 0.241_970_72).abs() < 1e-7);
    }
}
