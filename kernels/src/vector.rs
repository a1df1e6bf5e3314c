//! A hardware vector of floats, as far as products of matrices and softmax need one.

/// `LANES` floats, operated on as one.
///
/// Every method is `#[inline(always)]`: it must end up in a function compiled for the instructions
/// that it uses, and on a processor that has them. Pointers need no alignment.
pub(super) trait Vector: Copy {
    const LANES: usize;

    /// Most rows of a tile that is 1, 2, 3 or 4 vectors wide; 0 where there is none. The sums of a
    /// tile, one row of vectors and one broadcast number fit in the registers.
    const TILE_ROWS: [usize; 4];

    /// Of the vector's first lanes.
    type Mask: Copy;

    /// The first `count` lanes, or all if there are fewer.
    unsafe fn mask(count: usize) -> Self::Mask;

    unsafe fn splat(value: f32) -> Self;

    unsafe fn load(from: *const f32) -> Self;

    /// The lanes of the mask, which alone are read; those of `others` elsewhere.
    unsafe fn load_masked(from: *const f32, mask: Self::Mask, others: Self) -> Self;

    unsafe fn store(self, to: *mut f32);

    /// The lanes of the mask, which alone are written.
    unsafe fn store_masked(self, to: *mut f32, mask: Self::Mask);

    unsafe fn add(self, other: Self) -> Self;

    unsafe fn sub(self, other: Self) -> Self;

    unsafe fn mul(self, other: Self) -> Self;

    /// The greater; unspecified when one is not a number.
    unsafe fn max(self, other: Self) -> Self;

    /// The greatest lane.
    #[inline(always)]
    unsafe fn greatest(self) -> f32 {
        // SAFETY: the caller says that the processor has the instructions.
        unsafe { of_lanes(self, f32::max) }
    }

    /// All lanes added, the halves first.
    #[inline(always)]
    unsafe fn total(self) -> f32 {
        // SAFETY: see above.
        unsafe { of_lanes(self, |a, b| a + b) }
    }

    /// `self · factor + sum`, rounded once where the instructions have it.
    unsafe fn mul_add(self, factor: Self, sum: Self) -> Self;

    /// `2^power`, where the integer `power`, from -126 to 127, sits in the low bits of each lane.
    unsafe fn power_of_two(self) -> Self;
}

/// All lanes put together, the halves first.
#[inline(always)]
unsafe fn of_lanes<V: Vector>(vector: V, operation: fn(f32, f32) -> f32) -> f32 {
    let mut lanes = [0.0; 16];
    // SAFETY: no vector has more lanes.
    unsafe { vector.store(lanes.as_mut_ptr()) };
    let mut count = V::LANES;
    while count > 1 {
        count /= 2;
        for lane in 0..count {
            lanes[lane] = operation(lanes[lane], lanes[lane + count]);
        }
    }
    lanes[0]
}

/// Lanes that the compiler makes vectors of as it can.
#[derive(Clone, Copy)]
pub(super) struct Plain([f32; 4]);

impl Vector for Plain {
    const LANES: usize = 4;
    const TILE_ROWS: [usize; 4] = [6, 4, 0, 0];
    type Mask = usize;

    #[inline(always)]
    unsafe fn mask(count: usize) -> usize {
        count.min(Self::LANES)
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Self([value; 4])
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        // SAFETY: the caller says that all lanes can be read.
        Self(unsafe { from.cast::<[f32; 4]>().read_unaligned() })
    }

    #[inline(always)]
    unsafe fn load_masked(from: *const f32, count: usize, others: Self) -> Self {
        if count == Self::LANES {
            // SAFETY: the caller says that the lanes of the mask can be read; these are all.
            return unsafe { Self::load(from) };
        }
        let mut lanes = others.0;
        for (lane, value) in lanes.iter_mut().enumerate().take(count) {
            // SAFETY: as above; this lane is of the mask.
            *value = unsafe { from.add(lane).read() };
        }
        Self(lanes)
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller says that all lanes can be written.
        unsafe { to.cast::<[f32; 4]>().write_unaligned(self.0) };
    }

    #[inline(always)]
    unsafe fn store_masked(self, to: *mut f32, count: usize) {
        for (lane, value) in self.0.into_iter().enumerate().take(count) {
            // SAFETY: the caller says that the lanes of the mask can be written.
            unsafe { to.add(lane).write(value) };
        }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] + other.0[lane]))
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] - other.0[lane]))
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] * other.0[lane]))
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|lane| {
            let (one, two) = (self.0[lane], other.0[lane]);
            if two > one { two } else { one }
        }))
    }

    #[inline(always)]
    unsafe fn power_of_two(self) -> Self {
        Self(self.0.map(|power| f32::from_bits((power.to_bits() << 23).wrapping_add(127 << 23))))
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, sum: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] * factor.0[lane] + sum.0[lane]))
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) mod x86 {
    use std::arch::x86_64::*;

    use super::Vector;

    /// With AVX-512F.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx512(__m512);

    /// With AVX2 and FMA.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(__m256);

    impl Vector for Avx512 {
        const LANES: usize = 16;
        const TILE_ROWS: [usize; 4] = [12, 12, 8, 6];
        type Mask = __mmask16;

        #[inline(always)]
        unsafe fn mask(count: usize) -> __mmask16 {
            if count >= 16 { u16::MAX } else { (1 << count) - 1 }
        }

        #[inline(always)]
        unsafe fn splat(value: f32) -> Self {
            // SAFETY: of this and the others: the trait says what the caller has to provide.
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
        unsafe fn add(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm512_add_ps(self.0, other.0) })
        }

        #[inline(always)]
        unsafe fn sub(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm512_sub_ps(self.0, other.0) })
        }

        #[inline(always)]
        unsafe fn mul(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm512_mul_ps(self.0, other.0) })
        }

        #[inline(always)]
        unsafe fn max(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm512_max_ps(self.0, other.0) })
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
        unsafe fn mul_add(self, factor: Self, sum: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm512_fmadd_ps(self.0, factor.0, sum.0) })
        }
    }

    impl Vector for Avx2 {
        const LANES: usize = 8;
        const TILE_ROWS: [usize; 4] = [8, 6, 0, 0];
        type Mask = __m256i;

        #[inline(always)]
        unsafe fn mask(count: usize) -> __m256i {
            let count = i32::try_from(count).unwrap_or(i32::MAX);
            // SAFETY: see above.
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
        unsafe fn add(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }

        #[inline(always)]
        unsafe fn sub(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }

        #[inline(always)]
        unsafe fn mul(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }

        #[inline(always)]
        unsafe fn max(self, other: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
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
        unsafe fn mul_add(self, factor: Self, sum: Self) -> Self {
            // SAFETY: see above.
            Self(unsafe { _mm256_fmadd_ps(self.0, factor.0, sum.0) })
        }
    }
}
