//! The exponential in lanes.

use std::f64::consts::LOG2_E;

use crate::Lanes;
use crate::trigonometry::polynomial;

/// The constants of the exponential function for a number format.
pub struct Exponential {
    /// 1.5 · 2^(mantissa bits). Adding it rounds to an integer, which is then in the low bits.
    pub(crate) rounder: f64,
    /// ln 2 as an unevaluated sum of two numbers of the format.
    pub(crate) ln_2: [f64; 2],
    /// Taylor coefficients, highest power first. On |r| ≤ ½ ln 2 the first omitted term is below
    /// half a last place.
    pub(crate) series: &'static [f64],
}

pub(crate) const F32: Exponential = Exponential {
    rounder: 12_582_912.0,
    ln_2: [0.693_147_182_464_599_6, -1.904_654_299_957_768e-9],
    series: TAYLOR.split_at(TAYLOR.len() - 8).1,
};

pub(crate) const F64: Exponential = Exponential {
    rounder: 6_755_399_441_055_744.0,
    ln_2: [std::f64::consts::LN_2, 2.319_046_813_846_299_6e-17],
    series: &TAYLOR,
};

/// 1/13!, .., 1/1!, 1/0!.
const TAYLOR: [f64; 14] = {
    let mut inverse_factorials = [1.0; 14];
    let mut factorial = 1.0;
    let mut n = 1;
    while n < 14 {
        factorial *= n as f64;
        inverse_factorials[13 - n] = 1.0 / factorial;
        n += 1;
    }
    inverse_factorials
};

#[inline(always)]
pub(crate) fn exp<L: Lanes>(x: L) -> L {
    let format = const { L::EXPONENTIAL };
    let rounder = L::splat(format.rounder);
    let power = x.mul_add(L::splat(LOG2_E), rounder);
    let doublings = power - rounder;
    let r = doublings.neg_mul_add(L::splat(format.ln_2[0]), x);
    let r = doublings.neg_mul_add(L::splat(format.ln_2[1]), r);
    polynomial(format.series, r).doubled(power)
}

#[cfg(test)]
mod tests {
    use crate::{F32Array, F64Array, Lanes};

    #[test]
    fn the_exponential_is_accurate_to_the_format_up_to_its_range() {
        for step in -80_000..=80_000 {
            let x = f64::from(step) * 0.001;
            let relative = F64Array::<1>::splat(x).exp().lane(0) / x.exp() - 1.0;
            assert!(relative.abs() < 4.5e-16, "exp {x}: {relative:e}");

            let single = F32Array::<1>::splat(x);
            let relative = single.exp().lane(0) / single.lane(0).exp() - 1.0;
            assert!(relative.abs() < 1.5e-7, "f32 exp {x}: {relative:e}");
        }
    }
}
