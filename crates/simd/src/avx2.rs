//! Lanes of 256 bits.

use std::arch::x86_64::*;

use crate::array::rounded;
use crate::x86::x86_lanes;
use crate::{Lanes, Vector, exponential, trigonometry};

x86_lanes! {
    /// 8 lanes in single precision.
    F32x8(__m256) of f32, lanes 8, double F64x4,
    features "avx2,fma",
    trigonometry trigonometry::F32, exponential exponential::F32, round rounded,
    add _mm256_add_ps, sub _mm256_sub_ps, mul _mm256_mul_ps, div _mm256_div_ps,
    mul_add _mm256_fmadd_ps, neg_mul_add _mm256_fnmadd_ps,
    max _mm256_max_ps, xor _mm256_xor_ps, splat _mm256_set1_ps,
    load _mm256_loadu_ps, store _mm256_storeu_ps, turn_by_quadrant turn_f32, doubled doubled_f32,
}

x86_lanes! {
    /// 4 lanes in double precision.
    F64x4(__m256d) of f64, lanes 4, double F64x4,
    features "avx2,fma",
    trigonometry trigonometry::F64, exponential exponential::F64, round std::convert::identity,
    add _mm256_add_pd, sub _mm256_sub_pd, mul _mm256_mul_pd, div _mm256_div_pd,
    mul_add _mm256_fmadd_pd, neg_mul_add _mm256_fnmadd_pd,
    max _mm256_max_pd, xor _mm256_xor_pd, splat _mm256_set1_pd,
    load |values| _mm256_cvtps_pd(_mm_loadu_ps(values)),
    store |values, lanes| _mm_storeu_ps(values, _mm256_cvtpd_ps(lanes)),
    turn_by_quadrant turn_f64, doubled doubled_f64,
}

impl Vector for F32x8 {
    const LANES: usize = 8;
    type Mask = __m256i;

    #[inline(always)]
    unsafe fn mask(count: usize) -> __m256i {
        let count = i32::try_from(count).unwrap_or(i32::MAX);
        // SAFETY: here and below, the trait says what the caller must guarantee.
        unsafe {
            let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            _mm256_cmpgt_epi32(_mm256_set1_epi32(count), lanes)
        }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm256_loadu_ps(from) })
    }

    #[inline(always)]
    unsafe fn load_masked(from: *const f32, mask: __m256i, others: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe {
            let lanes = _mm256_maskload_ps(from, mask);
            _mm256_blendv_ps(others.0, lanes, _mm256_castsi256_ps(mask))
        })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: see above.
        unsafe { _mm256_storeu_ps(to, self.0) };
    }

    #[inline(always)]
    unsafe fn store_masked(self, to: *mut f32, mask: __m256i) {
        // SAFETY: see above.
        unsafe { _mm256_maskstore_ps(to, mask, self.0) };
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        Lanes::max(self, other)
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, sum: Self) -> Self {
        Lanes::mul_add(self, factor, sum)
    }

    #[inline(always)]
    unsafe fn power_of_two(self) -> Self {
        // SAFETY: see above.
        unsafe {
            let shifted = _mm256_slli_epi32::<23>(_mm256_castps_si256(self.0));
            let one = _mm256_castps_si256(_mm256_set1_ps(1.0));
            Self(_mm256_castsi256_ps(_mm256_add_epi32(shifted, one)))
        }
    }

    #[inline(always)]
    unsafe fn halves(self) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let pairs = _mm256_castps_si256(self.0);
            let high = _mm256_and_si256(pairs, _mm256_set1_epi32(0xffff_0000_u32.cast_signed()));
            [_mm256_slli_epi32::<16>(pairs), high].map(|half| Self(_mm256_castsi256_ps(half)))
        }
    }

    #[inline(always)]
    unsafe fn deinterleave(self, other: Self) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            // Pairs of lanes of both vectors come in turn and are put in order.
            let even = _mm256_castps_pd(_mm256_shuffle_ps::<0x88>(self.0, other.0));
            let odd = _mm256_castps_pd(_mm256_shuffle_ps::<0xdd>(self.0, other.0));
            [even, odd].map(|pairs| Self(_mm256_castpd_ps(_mm256_permute4x64_pd::<0xd8>(pairs))))
        }
    }

    #[inline(always)]
    unsafe fn interleave(self, other: Self) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let low = _mm256_unpacklo_ps(self.0, other.0);
            let high = _mm256_unpackhi_ps(self.0, other.0);
            [
                Self(_mm256_permute2f128_ps::<0x20>(low, high)),
                Self(_mm256_permute2f128_ps::<0x31>(low, high)),
            ]
        }
    }

    #[inline(always)]
    unsafe fn shifted(self, next: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let turned = _mm256_blend_ps::<1>(self.0, next.0);
            let lanes = _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 0);
            Self(_mm256_permutevar8x32_ps(turned, lanes))
        }
    }
}

#[inline]
#[target_feature(enable = "avx2")]
fn turn_f32(quadrant: __m256, sin: __m256, cos: __m256) -> (__m256, __m256) {
    let quadrant = _mm256_castps_si256(quadrant);
    let two = _mm256_set1_epi32(2);
    // `blendv` selects by the sign bit. The shift moves the lowest bit there.
    let odd = _mm256_castsi256_ps(_mm256_slli_epi32::<31>(quadrant));
    let sin_sign = _mm256_slli_epi32::<30>(_mm256_and_si256(quadrant, two));
    let next = _mm256_add_epi32(quadrant, _mm256_set1_epi32(1));
    let cos_sign = _mm256_slli_epi32::<30>(_mm256_and_si256(next, two));
    (
        _mm256_xor_ps(_mm256_blendv_ps(sin, cos, odd), _mm256_castsi256_ps(sin_sign)),
        _mm256_xor_ps(_mm256_blendv_ps(cos, sin, odd), _mm256_castsi256_ps(cos_sign)),
    )
}

#[inline]
#[target_feature(enable = "avx2")]
fn turn_f64(quadrant: __m256d, sin: __m256d, cos: __m256d) -> (__m256d, __m256d) {
    let quadrant = _mm256_castpd_si256(quadrant);
    let two = _mm256_set1_epi64x(2);
    // `blendv` selects by the sign bit. The shift moves the lowest bit there.
    let odd = _mm256_castsi256_pd(_mm256_slli_epi64::<63>(quadrant));
    let sin_sign = _mm256_slli_epi64::<62>(_mm256_and_si256(quadrant, two));
    let next = _mm256_add_epi64(quadrant, _mm256_set1_epi64x(1));
    let cos_sign = _mm256_slli_epi64::<62>(_mm256_and_si256(next, two));
    (
        _mm256_xor_pd(_mm256_blendv_pd(sin, cos, odd), _mm256_castsi256_pd(sin_sign)),
        _mm256_xor_pd(_mm256_blendv_pd(cos, sin, odd), _mm256_castsi256_pd(cos_sign)),
    )
}

#[inline]
#[target_feature(enable = "avx2")]
fn doubled_f32(value: __m256, power: __m256) -> __m256 {
    let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(power));
    _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(value), exponent))
}

#[inline]
#[target_feature(enable = "avx2")]
fn doubled_f64(value: __m256d, power: __m256d) -> __m256d {
    let exponent = _mm256_slli_epi64::<52>(_mm256_castpd_si256(power));
    _mm256_castsi256_pd(_mm256_add_epi64(_mm256_castpd_si256(value), exponent))
}
