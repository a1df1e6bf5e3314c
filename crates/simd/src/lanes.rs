//! One value per lane, with the same bits for every lane type.
//!
//! A lane type is a hardware vector, or an array where this crate supports no vectors. All types
//! round alike. They use only `+ − × ÷`, comparisons and *fused* multiply-adds, which IEEE 754
//! defines to the last bit.

use std::ops::{Add, Mul, Neg, Sub};

use crate::{Exponential, Trigonometry, exponential, trigonometry};

/// The most lanes a lane type has.
pub const MAX_LANES: usize = 16;

/// A computation in lanes of the type `L`.
pub trait Kernel<L> {
    /// The result.
    type Output;

    /// Does the computation. Implementations are `#[inline(always)]`, so that [`Lanes::run`]
    /// compiles them for the instructions of `L`.
    fn run(self) -> Self::Output;
}

/// Evaluates `$body` with `$lanes` as the type of the f32 lanes of an [`InstructionSet`].
///
/// [`InstructionSet`]: crate::InstructionSet
#[macro_export]
macro_rules! with_f32_lanes {
    ($instructions:expr, $lanes:ident => $body:expr) => {
        match $instructions {
            #[cfg(target_arch = "x86_64")]
            $crate::InstructionSet::Avx512(_) => {
                type $lanes = $crate::F32x16;
                $body
            }
            #[cfg(target_arch = "x86_64")]
            $crate::InstructionSet::Avx2(_) => {
                type $lanes = $crate::F32x8;
                $body
            }
            $crate::InstructionSet::Portable => {
                type $lanes = $crate::F32Array<8>;
                $body
            }
        }
    };
}

/// [`with_f32_lanes`](crate::with_f32_lanes) for lanes of f64.
#[macro_export]
macro_rules! with_f64_lanes {
    ($instructions:expr, $lanes:ident => $body:expr) => {
        match $instructions {
            #[cfg(target_arch = "x86_64")]
            $crate::InstructionSet::Avx512(_) => {
                type $lanes = $crate::F64x8;
                $body
            }
            #[cfg(target_arch = "x86_64")]
            $crate::InstructionSet::Avx2(_) => {
                type $lanes = $crate::F64x4;
                $body
            }
            $crate::InstructionSet::Portable => {
                type $lanes = $crate::F64Array<4>;
                $body
            }
        }
    };
}

/// `LANES` floating-point numbers that are computed together.
///
/// Every method must be inlined into a function that is compiled for its instructions, and that
/// runs on a processor with them.
pub trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// The number of lanes.
    const LANES: usize;
    /// Coefficients that make [`Lanes::sin_cos`] as accurate as the number format.
    const TRIGONOMETRY: Trigonometry;
    /// Constants that make [`Lanes::exp`] as accurate as the number format.
    const EXPONENTIAL: Exponential;
    /// Lanes of f64 with the same instructions.
    type Double: Lanes;

    /// Runs a kernel in a function of its own that is compiled for the instructions of these lanes.
    #[inline(never)]
    fn run<K: Kernel<Self>>(kernel: K) -> K::Output {
        kernel.run()
    }

    /// The same number in every lane, rounded to its format.
    fn splat(value: f64) -> Self;
    /// `self · b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c − self · b`, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// 1 / `self`.
    fn recip(self) -> Self;
    /// The greater one; unspecified if one is NaN.
    fn max(self, other: Self) -> Self;
    /// Exchanges and negates sine and cosine of an angle that was reduced by `quadrant` quarter
    /// turns. The integer `quadrant` is in the low bits of each lane's representation.
    fn turn_by_quadrant(quadrant: Self, sin: Self, cos: Self) -> (Self, Self);

    /// `self · 2^power`. The integer `power` is in the low bits of each lane's representation, and
    /// the result is in the normal range.
    fn doubled(self, power: Self) -> Self;

    /// The number of a lane.
    fn lane(&self, lane: usize) -> f64;
    /// Rounds `value` to the lane's format.
    fn set_lane(&mut self, lane: usize, value: f64);
    /// Loads the first `LANES` of `values`.
    fn load(values: &[f32; MAX_LANES]) -> Self;
    /// Stores into the first `LANES` of `values`, rounded.
    fn store(self, values: &mut [f32; MAX_LANES]);

    /// The nearest integer while |self| < 2²² in single precision and 2⁵¹ in double. Beyond, it is
    /// off by about the last place.
    #[inline(always)]
    fn round(self) -> Self {
        let rounder = Self::splat(Self::TRIGONOMETRY.rounder);
        (self + rounder) - rounder
    }

    /// Sine and cosine of angles in rad, with an error of about the last place while |angle| < 10⁴.
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        trigonometry::sin_cos(self)
    }

    /// Sine and cosine − 1 of angles between two instants of a step, in rad. The error is about the
    /// last place of sine and cosine while |angle| ≤ 0.5, and 3 · 10⁻⁵ at 1 in single precision.
    #[inline(always)]
    fn small_sin_cos(self) -> (Self, Self) {
        trigonometry::small_sin_cos(self)
    }

    /// e to the power of `self`, with an error of about the last place while |self| ≤ 87.
    #[inline(always)]
    fn exp(self) -> Self {
        exponential::exp(self)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{Lanes, MAX_LANES};
    use crate::{F32Array, F64Array, InstructionSet};

    /// Bits of every operation on the numbers, lane after lane.
    #[inline(never)]
    fn bits<L: Lanes>(numbers: &[[f64; 3]]) -> Vec<u64> {
        let mut bits = Vec::new();
        for numbers in numbers.chunks(L::LANES) {
            let mut operands = [L::splat(0.0); 3];
            for (lane, numbers) in numbers.iter().enumerate() {
                for (operand, &number) in operands.iter_mut().zip(numbers) {
                    operand.set_lane(lane, number);
                }
            }
            let [a, b, c] = operands;
            let (sin, cos) = a.sin_cos();
            let (small_sin, small_cos) = b.small_sin_cos();
            let mut stored = [0.0; MAX_LANES];
            a.store(&mut stored);
            let results = [
                a + b,
                a - b,
                a * b,
                -a,
                a.mul_add(b, c),
                a.neg_mul_add(b, c),
                a.recip(),
                a.max(b),
                sin,
                cos,
                small_sin,
                small_cos,
                c.exp(),
                a.round(),
                L::load(&stored),
            ];
            for lane in 0..numbers.len() {
                bits.extend(results.map(|result| result.lane(lane).to_bits()));
            }
        }
        bits
    }

    proptest! {
        #[test]
        fn every_lane_type_has_the_bits_of_the_arrays(
            numbers in prop::collection::vec(
                [-1e3..1e3f64, -0.5..0.5f64, -80.0..80.0f64],
                1..40,
            ),
        ) {
            let (single, double) = (bits::<F32Array<1>>(&numbers), bits::<F64Array<1>>(&numbers));
            prop_assert_eq!(&bits::<F32Array<8>>(&numbers), &single);
            prop_assert_eq!(&bits::<F64Array<4>>(&numbers), &double);
            for set in InstructionSet::available() {
                match set {
                    #[cfg(target_arch = "x86_64")]
                    InstructionSet::Avx512(_) => {
                        prop_assert_eq!(bits::<crate::F32x16>(&numbers), single.clone());
                        prop_assert_eq!(bits::<crate::F64x8>(&numbers), double.clone());
                    }
                    #[cfg(target_arch = "x86_64")]
                    InstructionSet::Avx2(_) => {
                        prop_assert_eq!(bits::<crate::F32x8>(&numbers), single.clone());
                        prop_assert_eq!(bits::<crate::F64x4>(&numbers), double.clone());
                    }
                    InstructionSet::Portable => {}
                }
            }
        }
    }
}
