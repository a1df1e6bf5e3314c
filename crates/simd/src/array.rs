//! Lanes as plain arrays, for single robots and for processors whose vectors this crate does not
//! support.
//!
//! The compiler vectorizes them where it can. aarch64 fuses `mul_add` in hardware. On an x86-64
//! without FMA it is a library call, which is slow but exact to the last bit.

use std::ops::{Add, Mul, Neg, Sub};

use crate::{Exponential, Lanes, MAX_LANES, Trigonometry, exponential, trigonometry};

macro_rules! array_lanes {
    ($(#[$doc:meta])* $name:ident, $scalar:ty, $bits:ty, $trigonometry:expr, $exponential:expr, $round:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        #[repr(C, align(32))]
        pub struct $name<const N: usize>([$scalar; N]);

        impl<const N: usize> Add for $name<N> {
            type Output = Self;
            #[inline(always)]
            fn add(mut self, other: Self) -> Self {
                for i in 0..N {
                    self.0[i] += other.0[i];
                }
                self
            }
        }

        impl<const N: usize> Sub for $name<N> {
            type Output = Self;
            #[inline(always)]
            fn sub(mut self, other: Self) -> Self {
                for i in 0..N {
                    self.0[i] -= other.0[i];
                }
                self
            }
        }

        impl<const N: usize> Mul for $name<N> {
            type Output = Self;
            #[inline(always)]
            fn mul(mut self, other: Self) -> Self {
                for i in 0..N {
                    self.0[i] *= other.0[i];
                }
                self
            }
        }

        impl<const N: usize> Neg for $name<N> {
            type Output = Self;
            #[inline(always)]
            fn neg(mut self) -> Self {
                for i in 0..N {
                    self.0[i] = -self.0[i];
                }
                self
            }
        }

        impl<const N: usize> Lanes for $name<N> {
            const LANES: usize = N;
            const TRIGONOMETRY: Trigonometry = $trigonometry;
            const EXPONENTIAL: Exponential = $exponential;
            type Double = F64Array<N>;

            #[inline(always)]
            fn splat(value: f64) -> Self {
                Self([$round(value); N])
            }

            #[inline(always)]
            fn mul_add(mut self, b: Self, c: Self) -> Self {
                for i in 0..N {
                    self.0[i] = self.0[i].mul_add(b.0[i], c.0[i]);
                }
                self
            }

            #[inline(always)]
            fn neg_mul_add(mut self, b: Self, c: Self) -> Self {
                for i in 0..N {
                    self.0[i] = (-self.0[i]).mul_add(b.0[i], c.0[i]);
                }
                self
            }

            #[inline(always)]
            fn recip(mut self) -> Self {
                for i in 0..N {
                    self.0[i] = 1.0 / self.0[i];
                }
                self
            }

            #[inline(always)]
            fn max(mut self, other: Self) -> Self {
                for i in 0..N {
                    if other.0[i] > self.0[i] {
                        self.0[i] = other.0[i];
                    }
                }
                self
            }

            #[inline(always)]
            fn turn_by_quadrant(quadrant: Self, sin: Self, cos: Self) -> (Self, Self) {
                let (mut turned_sin, mut turned_cos) = (sin, cos);
                for i in 0..N {
                    let quadrant = quadrant.0[i].to_bits();
                    let (s, c) =
                        if quadrant & 1 == 0 { (sin.0[i], cos.0[i]) } else { (cos.0[i], sin.0[i]) };
                    let sign_of = |bit: $bits| (bit & 2) << (<$bits>::BITS - 2);
                    turned_sin.0[i] = <$scalar>::from_bits(s.to_bits() ^ sign_of(quadrant));
                    turned_cos.0[i] =
                        <$scalar>::from_bits(c.to_bits() ^ sign_of(quadrant.wrapping_add(1)));
                }
                (turned_sin, turned_cos)
            }

            #[inline(always)]
            fn doubled(mut self, power: Self) -> Self {
                const MANTISSA_BITS: u32 = <$scalar>::MANTISSA_DIGITS - 1;
                for i in 0..N {
                    let exponent = power.0[i].to_bits() << MANTISSA_BITS;
                    self.0[i] = <$scalar>::from_bits(self.0[i].to_bits().wrapping_add(exponent));
                }
                self
            }

            #[inline(always)]
            fn lane(&self, lane: usize) -> f64 {
                f64::from(self.0[lane])
            }

            #[inline(always)]
            fn set_lane(&mut self, lane: usize, value: f64) {
                self.0[lane] = $round(value);
            }

            #[inline(always)]
            fn load(values: &[f32; MAX_LANES]) -> Self {
                let mut lanes = [0.0; N];
                for i in 0..N {
                    lanes[i] = <$scalar>::from(values[i]);
                }
                Self(lanes)
            }

            #[inline(always)]
            fn store(self, values: &mut [f32; MAX_LANES]) {
                for i in 0..N {
                    values[i] = rounded(f64::from(self.0[i]));
                }
            }
        }
    };
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to the nearest f32 is the purpose")]
#[inline(always)]
pub(crate) fn rounded(value: f64) -> f32 {
    value as f32
}

array_lanes!(
    /// `N` lanes in single precision.
    F32Array, f32, u32, trigonometry::F32, exponential::F32, rounded
);
array_lanes!(
    /// `N` lanes in double precision.
    F64Array, f64, u64, trigonometry::F64, exponential::F64, std::convert::identity
);
