//! Sine and cosine in lanes.

use std::f64::consts::FRAC_2_PI;

use crate::Lanes;

/// The constants of sine and cosine for a number format.
///
/// Polynomials and splittings are those of S. L. Moshier's Cephes library (`sinf.c`, `sin.c`).
pub struct Trigonometry {
    /// 1.5 · 2^(mantissa bits). Adding it rounds to an integer, which is then in the low bits.
    pub(crate) rounder: f64,
    /// π/2 as an unevaluated sum of two numbers of the format.
    pub(crate) half_pi: [f64; 2],
    /// sin r = r + r³ P(r²), highest power first.
    pub(crate) sin: &'static [f64],
    /// cos r = 1 − r²/2 + r⁴ P(r²), highest power first.
    pub(crate) cos: &'static [f64],
    /// sin r = r + r³ P(r²) by Taylor, for angles near 0 without reduction, highest power first.
    pub(crate) small_sin: &'static [f64],
    /// cos r = 1 + r² P(r²), highest power first.
    pub(crate) small_cos: &'static [f64],
}

pub(crate) const F32: Trigonometry = Trigonometry {
    rounder: 12_582_912.0,
    half_pi: [1.570_796_370_506_286_6, -4.371_139_000_186_243e-8],
    sin: &[-1.951_529_589_1e-4, 8.332_160_873_6e-3, -1.666_665_461_1e-1],
    cos: &[2.443_315_711_809_948e-5, -1.388_731_625_493_765e-3, 4.166_664_568_298_827e-2],
    small_sin: &[-1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0],
    small_cos: &[-1.0 / 720.0, 1.0 / 24.0, -0.5],
};

pub(crate) const F64: Trigonometry = Trigonometry {
    rounder: 6_755_399_441_055_744.0,
    half_pi: [std::f64::consts::FRAC_PI_2, 6.123_233_995_736_766e-17],
    sin: &[
        1.589_623_015_765_465_7e-10,
        -2.505_074_776_285_780_7e-8,
        2.755_731_362_138_572_2e-6,
        -1.984_126_982_958_954e-4,
        8.333_333_333_322_118e-3,
        -1.666_666_666_666_663e-1,
    ],
    cos: &[
        -1.135_853_652_138_768_2e-11,
        2.087_570_084_197_473e-9,
        -2.755_731_417_929_674e-7,
        2.480_158_728_885_170_4e-5,
        -1.388_888_888_887_305_6e-3,
        4.166_666_666_666_659e-2,
    ],
    small_sin: &[
        1.0 / 6_227_020_800.0,
        -1.0 / 39_916_800.0,
        1.0 / 362_880.0,
        -1.0 / 5040.0,
        1.0 / 120.0,
        -1.0 / 6.0,
    ],
    small_cos: &[
        -1.0 / 87_178_291_200.0,
        1.0 / 479_001_600.0,
        -1.0 / 3_628_800.0,
        1.0 / 40_320.0,
        -1.0 / 720.0,
        1.0 / 24.0,
        -0.5,
    ],
};

#[inline(always)]
pub(crate) fn sin_cos<L: Lanes>(angle: L) -> (L, L) {
    let format = const { L::TRIGONOMETRY };
    let rounder = L::splat(format.rounder);
    let quadrant = angle.mul_add(L::splat(FRAC_2_PI), rounder);
    let quarter_turns = quadrant - rounder;
    let r = quarter_turns.neg_mul_add(L::splat(format.half_pi[0]), angle);
    let r = quarter_turns.neg_mul_add(L::splat(format.half_pi[1]), r);
    let z = r * r;
    let sin = (r * z).mul_add(polynomial(format.sin, z), r);
    let one_minus_half_z = z.mul_add(L::splat(-0.5), L::splat(1.0));
    let cos = (z * z).mul_add(polynomial(format.cos, z), one_minus_half_z);
    L::turn_by_quadrant(quadrant, sin, cos)
}

/// Sine and cosine − 1.
#[inline(always)]
pub(crate) fn small_sin_cos<L: Lanes>(angle: L) -> (L, L) {
    let format = const { L::TRIGONOMETRY };
    let z = angle * angle;
    let sin = (angle * z).mul_add(polynomial(format.small_sin, z), angle);
    (sin, z * polynomial(format.small_cos, z))
}

/// Σ coefficients · powers of `x`, highest power first.
#[inline(always)]
pub(crate) fn polynomial<L: Lanes>(coefficients: &'static [f64], x: L) -> L {
    let mut sum = L::splat(coefficients[0]);
    for &coefficient in &coefficients[1..] {
        sum = sum.mul_add(x, L::splat(coefficient));
    }
    sum
}

#[cfg(test)]
mod tests {
    use crate::{F32Array, F64Array, Lanes};

    #[test]
    fn sine_and_cosine_are_accurate_to_the_format_over_many_turns() {
        for step in -40_000..=40_000 {
            let angle = f64::from(step) * 0.002_617;
            let (sin, cos) = F64Array::<1>::splat(angle).sin_cos();
            assert!((sin.lane(0) - angle.sin()).abs() < 2.5e-16, "sin {angle}");
            assert!((cos.lane(0) - angle.cos()).abs() < 2.5e-16, "cos {angle}");

            let single = F32Array::<1>::splat(angle);
            let angle = single.lane(0);
            let (sin, cos) = single.sin_cos();
            assert!((sin.lane(0) - angle.sin()).abs() < 1.2e-7, "f32 sin {angle}");
            assert!((cos.lane(0) - angle.cos()).abs() < 1.2e-7, "f32 cos {angle}");
        }
    }

    #[test]
    fn small_sines_and_cosines_are_accurate_to_the_format_up_to_half_a_radian() {
        for step in -1000..=1000 {
            let angle = f64::from(step) * 0.0005;
            let (sin, cos_less_1) = F64Array::<1>::splat(angle).small_sin_cos();
            assert!((sin.lane(0) - angle.sin()).abs() < 1.2e-16, "sin {angle}");
            assert!((1.0 + cos_less_1.lane(0) - angle.cos()).abs() < 2.3e-16, "cos {angle}");

            let single = F32Array::<1>::splat(angle);
            let angle = single.lane(0);
            let (sin, cos_less_1) = single.small_sin_cos();
            assert!((sin.lane(0) - angle.sin()).abs() < 6e-8, "f32 sin {angle}");
            assert!((1.0 + cos_less_1.lane(0) - angle.cos()).abs() < 1.1e-7, "f32 cos {angle}");
        }
    }
}
