//! One value per robot, several robots per register.
//!
//! The simulation is written once over [`Lanes`]; a lane type is a hardware vector or, where there
//! is none of ours, an array. All of them round alike: only `+ − × ÷`, comparisons and *fused*
//! multiply-adds are used, each of which IEEE 754 defines to the last bit, so that a trajectory has
//! the same bits on every lane type.

mod array;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod exponential;
mod kernels;
mod trigonometry;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::ops::{Add, Mul, Neg, Sub};

#[cfg(test)]
pub(crate) use array::rounded;
pub(crate) use array::{F32Array, F64Array};
#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::{F32x8, F64x4};
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::{F32x16, F64x8};
pub(crate) use exponential::Exponential;
pub(crate) use kernels::Kernels;
pub(crate) use trigonometry::Trigonometry;

/// The most lanes a lane type has.
pub(crate) const MAX_LANES: usize = 16;

/// `LANES` floating-point numbers, operated on as one.
///
/// Every method is `#[inline(always)]`: it must end up inside a function that is compiled for the
/// instructions it uses (see [`Kernels`]).
pub(crate) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    const LANES: usize;
    /// Coefficients that make [`Lanes::sin_cos`] as accurate as the number format.
    const TRIGONOMETRY: Trigonometry;
    /// Constants that make [`Lanes::exp`] as accurate as the number format.
    const EXPONENTIAL: Exponential;
    /// Lanes of f64 with the same instructions.
    type Double: Lanes;

    fn splat(value: f64) -> Self;
    /// `self · b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c − self · b`, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    fn recip(self) -> Self;
    /// The greater; unspecified when one is not a number.
    fn max(self, other: Self) -> Self;
    /// Exchanges and negates sine and cosine of an angle reduced by `quadrant` quarter turns, where
    /// the integer `quadrant` sits in the low bits of each lane's representation.
    fn turn_by_quadrant(quadrant: Self, sin: Self, cos: Self) -> (Self, Self);

    /// `self · 2^power`, where the integer `power` sits in the low bits of each lane's representation
    /// and the result is in the normal range.
    fn doubled(self, power: Self) -> Self;

    fn lane(&self, lane: usize) -> f64;
    /// Rounds `value` to the lane's format.
    fn set_lane(&mut self, lane: usize, value: f64);
    /// The first `LANES` of `values`.
    fn load(values: &[f32; MAX_LANES]) -> Self;
    /// Into the first `LANES` of `values`, rounded.
    fn store(self, values: &mut [f32; MAX_LANES]);

    /// Sine and cosine of angles in rad, to about the last place while |angle| < 10⁴.
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        trigonometry::sin_cos(self)
    }

    /// Sine and cosine − 1 of angles between two instants of a step, in rad: to the last place of sine
    /// and cosine while |angle| ≤ 0.5, and to 3 · 10⁻⁵ at 1 in single precision.
    #[inline(always)]
    fn small_sin_cos(self) -> (Self, Self) {
        trigonometry::small_sin_cos(self)
    }

    /// e to the power of `self`, to about the last place while |self| ≤ 87.
    #[inline(always)]
    fn exp(self) -> Self {
        exponential::exp(self)
    }
}
