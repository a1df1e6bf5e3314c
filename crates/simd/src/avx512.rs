//! Lanes of 512 bits.

use std::arch::x86_64::*;

use crate::array::rounded;
use crate::x86::x86_lanes;
use crate::{Lanes, Vector, exponential, trigonometry};

x86_lanes! {
    /// 16 lanes in single precision.
    F32x16(__m512) of f32, lanes 16, double F64x8,
    features "avx512f,avx512dq,avx512vl,avx2,fma",
    trigonometry trigonometry::F32, exponential exponential::F32, round rounded,
    add _mm512_add_ps, sub _mm512_sub_ps, mul _mm512_mul_ps, div _mm512_div_ps,
    mul_add _mm512_fmadd_ps, neg_mul_add _mm512_fnmadd_ps,
    max _mm512_max_ps, xor _mm512_xor_ps, splat _mm512_set1_ps,
    load _mm512_loadu_ps, store _mm512_storeu_ps, turn_by_quadrant turn_f32, doubled doubled_f32,
}

x86_lanes! {
    /// 8 lanes in double precision.
    F64x8(__m512d) of f64, lanes 8, double F64x8,
    features "avx512f,avx512dq,avx512vl,avx2,fma",
    trigonometry trigonometry::F64, exponential exponential::F64, round std::convert::identity,
    add _mm512_add_pd, sub _mm512_sub_pd, mul _mm512_mul_pd, div _mm512_div_pd,
    mul_add _mm512_fmadd_pd, neg_mul_add _mm512_fnmadd_pd,
    max _mm512_max_pd, xor _mm512_xor_pd, splat _mm512_set1_pd,
    load |values| _mm512_cvtps_pd(_mm256_loadu_ps(values)),
    store |values, lanes| _mm256_storeu_ps(values, _mm512_cvtpd_ps(lanes)),
    turn_by_quadrant turn_f64, doubled doubled_f64,
}

impl Vector for F32x16 {
    const LANES: usize = 16;
    type Mask = __mmask16;

    #[inline(always)]
    unsafe fn mask(count: usize) -> __mmask16 {
        if count >= 16 { u16::MAX } else { (1 << count) - 1 }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        // SAFETY: here and below, the trait says what the caller must guarantee.
        Self(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_loadu_ps(from) })
    }

    #[inline(always)]
    unsafe fn load_masked(from: *const f32, mask: __mmask16, others: Self) -> Self {
        // SAFETY: see above.
        Self(unsafe { _mm512_mask_loadu_ps(others.0, mask, from) })
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: see above.
        unsafe { _mm512_storeu_ps(to, self.0) };
    }

    #[inline(always)]
    unsafe fn store_masked(self, to: *mut f32, mask: __mmask16) {
        // SAFETY: see above.
        unsafe { _mm512_mask_storeu_ps(to, mask, self.0) };
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
            let shifted = _mm512_slli_epi32::<23>(_mm512_castps_si512(self.0));
            let one = _mm512_castps_si512(_mm512_set1_ps(1.0));
            Self(_mm512_castsi512_ps(_mm512_add_epi32(shifted, one)))
        }
    }

    #[inline(always)]
    unsafe fn halves(self) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let pairs = _mm512_castps_si512(self.0);
            let high = _mm512_and_si512(pairs, _mm512_set1_epi32(0xffff_0000_u32.cast_signed()));
            [_mm512_slli_epi32::<16>(pairs), high].map(|half| Self(_mm512_castsi512_ps(half)))
        }
    }

    #[inline(always)]
    unsafe fn deinterleave(self, other: Self) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_add_epi32(even, _mm512_set1_epi32(1));
            [even, odd].map(|lanes| Self(_mm512_permutex2var_ps(self.0, lanes, other.0)))
        }
    }

    #[inline(always)]
    unsafe fn interleave(self, other: Self) -> [Self; 2] {
        // SAFETY: see above.
        unsafe {
            let low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
            let high = _mm512_add_epi32(low, _mm512_set1_epi32(8));
            [low, high].map(|lanes| Self(_mm512_permutex2var_ps(self.0, lanes, other.0)))
        }
    }

    #[inline(always)]
    unsafe fn shifted(self, next: Self) -> Self {
        // SAFETY: see above.
        unsafe {
            let [this, next] = [self.0, next.0].map(|lanes| _mm512_castps_si512(lanes));
            Self(_mm512_castsi512_ps(_mm512_alignr_epi32::<1>(next, this)))
        }
    }

    #[inline(always)]
    unsafe fn greatest(self) -> f32 {
        // SAFETY: see above.
        unsafe { _mm512_reduce_max_ps(self.0) }
    }

    #[inline(always)]
    unsafe fn total(self) -> f32 {
        // SAFETY: see above.
        unsafe { _mm512_reduce_add_ps(self.0) }
    }
}

impl F32x16 {
    /// In each lane, `sum` plus the products of the high and of the low halves, which are bf16.
    ///
    /// # Safety
    /// The processor must have AVX-512 BF16.
    #[inline(always)]
    pub unsafe fn mul_add_halves(self, factor: Self, sum: Self) -> Self {
        // SAFETY: the caller guarantees the instruction. Both types have 512 bits, and every
        // pattern is a value.
        unsafe {
            let [a, b] =
                [self, factor].map(|pairs| std::mem::transmute::<__m512, __m512bh>(pairs.0));
            Self(_mm512_dpbf16_ps(sum.0, a, b))
        }
    }
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn turn_f32(quadrant: __m512, sin: __m512, cos: __m512) -> (__m512, __m512) {
    let quadrant = _mm512_castps_si512(quadrant);
    let (one, two) = (_mm512_set1_epi32(1), _mm512_set1_epi32(2));
    let odd = _mm512_test_epi32_mask(quadrant, one);
    let sin_sign = _mm512_slli_epi32::<30>(_mm512_and_si512(quadrant, two));
    let next = _mm512_add_epi32(quadrant, one);
    let cos_sign = _mm512_slli_epi32::<30>(_mm512_and_si512(next, two));
    (
        _mm512_xor_ps(_mm512_mask_blend_ps(odd, sin, cos), _mm512_castsi512_ps(sin_sign)),
        _mm512_xor_ps(_mm512_mask_blend_ps(odd, cos, sin), _mm512_castsi512_ps(cos_sign)),
    )
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn turn_f64(quadrant: __m512d, sin: __m512d, cos: __m512d) -> (__m512d, __m512d) {
    let quadrant = _mm512_castpd_si512(quadrant);
    let (one, two) = (_mm512_set1_epi64(1), _mm512_set1_epi64(2));
    let odd = _mm512_test_epi64_mask(quadrant, one);
    let sin_sign = _mm512_slli_epi64::<62>(_mm512_and_si512(quadrant, two));
    let next = _mm512_add_epi64(quadrant, one);
    let cos_sign = _mm512_slli_epi64::<62>(_mm512_and_si512(next, two));
    (
        _mm512_xor_pd(_mm512_mask_blend_pd(odd, sin, cos), _mm512_castsi512_pd(sin_sign)),
        _mm512_xor_pd(_mm512_mask_blend_pd(odd, cos, sin), _mm512_castsi512_pd(cos_sign)),
    )
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn doubled_f32(value: __m512, power: __m512) -> __m512 {
    let exponent = _mm512_slli_epi32::<23>(_mm512_castps_si512(power));
    _mm512_castsi512_ps(_mm512_add_epi32(_mm512_castps_si512(value), exponent))
}

#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn doubled_f64(value: __m512d, power: __m512d) -> __m512d {
    let exponent = _mm512_slli_epi64::<52>(_mm512_castpd_si512(power));
    _mm512_castsi512_pd(_mm512_add_epi64(_mm512_castpd_si512(value), exponent))
}
