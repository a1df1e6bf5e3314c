//! Floats in memory, a vector at a time.

use std::ops::{Add, Mul, Sub};

/// `LANES` floats that are computed together.
///
/// Every method must be inlined into a function that is compiled for its instructions, and that
/// runs on a processor with them. Pointers need no alignment.
pub trait Vector: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// At most 16.
    const LANES: usize;

    /// Selects the first lanes of a vector.
    type Mask: Copy;

    /// The first `count` lanes, or all if there are fewer.
    ///
    /// # Safety
    /// The processor must have the instructions. This holds for all methods below.
    unsafe fn mask(count: usize) -> Self::Mask;

    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn splat(value: f32) -> Self;

    /// # Safety
    /// All lanes must be readable.
    unsafe fn load(from: *const f32) -> Self;

    /// Loads the lanes of the mask, and takes those of `others` elsewhere.
    ///
    /// # Safety
    /// The lanes of the mask must be readable. The others are not read.
    unsafe fn load_masked(from: *const f32, mask: Self::Mask, others: Self) -> Self;

    /// # Safety
    /// All lanes must be writable.
    unsafe fn store(self, to: *mut f32);

    /// # Safety
    /// The lanes of the mask must be writable. The others are not written.
    unsafe fn store_masked(self, to: *mut f32, mask: Self::Mask);

    /// The greater one; unspecified if one is NaN.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn max(self, other: Self) -> Self;

    /// `self · factor + sum`, rounded once if the instructions can.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn mul_add(self, factor: Self, sum: Self) -> Self;

    /// `2^power`. The integer `power`, from -126 to 127, is in the low bits of each lane.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn power_of_two(self) -> Self;

    /// The low and the high halves of the lanes' bits. Each half is a bf16, which has the bits of
    /// an f32 without the lower sixteen.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn halves(self) -> [Self; 2];

    /// The lanes with even and those with odd numbers, where `other`'s lanes are counted after this
    /// vector's.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn deinterleave(self, other: Self) -> [Self; 2];

    /// The lanes of both vectors in turn: the inverse of [`Vector::deinterleave`].
    ///
    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn interleave(self, other: Self) -> [Self; 2];

    /// All lanes but the first, followed by the first lane of `next`.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    unsafe fn shifted(self, next: Self) -> Self;

    /// The greatest lane.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    #[inline(always)]
    unsafe fn greatest(self) -> f32 {
        // SAFETY: the caller guarantees that the processor has the instructions.
        unsafe { folded(self, f32::max) }
    }

    /// The sum of all lanes. It adds halves first.
    ///
    /// # Safety
    /// See [`Vector::mask`].
    #[inline(always)]
    unsafe fn total(self) -> f32 {
        // SAFETY: see above.
        unsafe { folded(self, |a, b| a + b) }
    }
}

/// Combines all lanes with `operation`, halves first.
#[inline(always)]
unsafe fn folded<V: Vector>(vector: V, operation: fn(f32, f32) -> f32) -> f32 {
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

/// Four lanes as an array, which the compiler may vectorize. Products are rounded before they are
/// added, because a fused multiply-add is a library call where there is no instruction.
#[derive(Clone, Copy)]
pub struct Unfused([f32; 4]);

macro_rules! lane_by_lane {
    ($($trait:ident $method:ident $assignment:tt),*) => {$(
        impl $trait for Unfused {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for lane in 0..4 {
                    self.0[lane] $assignment other.0[lane];
                }
                self
            }
        }
    )*};
}

lane_by_lane!(Add add +=, Sub sub -=, Mul mul *=);

impl Vector for Unfused {
    const LANES: usize = 4;
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
        // SAFETY: the caller guarantees that all lanes can be read.
        Self(unsafe { from.cast::<[f32; 4]>().read_unaligned() })
    }

    #[inline(always)]
    unsafe fn load_masked(from: *const f32, count: usize, others: Self) -> Self {
        if count == Self::LANES {
            // SAFETY: the caller guarantees that the lanes of the mask can be read, and these are
            // all.
            return unsafe { Self::load(from) };
        }
        let mut lanes = others.0;
        for lane in 0..count {
            // SAFETY: see above. This lane belongs to the mask.
            lanes[lane] = unsafe { from.add(lane).read() };
        }
        Self(lanes)
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the caller guarantees that all lanes can be written.
        unsafe { to.cast::<[f32; 4]>().write_unaligned(self.0) };
    }

    #[inline(always)]
    unsafe fn store_masked(self, to: *mut f32, count: usize) {
        for lane in 0..count {
            // SAFETY: the caller guarantees that the lanes of the mask can be written.
            unsafe { to.add(lane).write(self.0[lane]) };
        }
    }

    #[inline(always)]
    unsafe fn max(mut self, other: Self) -> Self {
        for lane in 0..4 {
            if other.0[lane] > self.0[lane] {
                self.0[lane] = other.0[lane];
            }
        }
        self
    }

    #[inline(always)]
    unsafe fn mul_add(self, factor: Self, sum: Self) -> Self {
        self * factor + sum
    }

    #[inline(always)]
    unsafe fn power_of_two(mut self) -> Self {
        for lane in 0..4 {
            let exponent = (self.0[lane].to_bits() << 23).wrapping_add(127 << 23);
            self.0[lane] = f32::from_bits(exponent);
        }
        self
    }

    #[inline(always)]
    unsafe fn halves(self) -> [Self; 2] {
        let [mut low, mut high] = [self; 2];
        for lane in 0..4 {
            let bits = self.0[lane].to_bits();
            low.0[lane] = f32::from_bits(bits << 16);
            high.0[lane] = f32::from_bits(bits & 0xffff_0000);
        }
        [low, high]
    }

    #[inline(always)]
    unsafe fn deinterleave(self, other: Self) -> [Self; 2] {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, other.0);
        [Self([a, c, e, g]), Self([b, d, f, h])]
    }

    #[inline(always)]
    unsafe fn interleave(self, other: Self) -> [Self; 2] {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, other.0);
        [Self([a, e, b, f]), Self([c, g, d, h])]
    }

    #[inline(always)]
    unsafe fn shifted(self, next: Self) -> Self {
        let ([_, b, c, d], [e, ..]) = (self.0, next.0);
        Self([b, c, d, e])
    }
}

#[cfg(test)]
mod tests {
    use super::{Unfused, Vector};

    /// Runs `check` for every type whose instructions this processor has.
    fn on_each(check: [fn(); 3]) {
        for set in crate::InstructionSet::available() {
            match set {
                #[cfg(target_arch = "x86_64")]
                crate::InstructionSet::Avx512(_) => check[0](),
                #[cfg(target_arch = "x86_64")]
                crate::InstructionSet::Avx2(_) => check[1](),
                crate::InstructionSet::Portable => check[2](),
            }
        }
    }

    macro_rules! on_each {
        ($check:ident) => {
            #[cfg(target_arch = "x86_64")]
            on_each([$check::<crate::F32x16>, $check::<crate::F32x8>, $check::<Unfused>]);
            #[cfg(not(target_arch = "x86_64"))]
            on_each([$check::<Unfused>; 3]);
        };
    }

    const NUMBERS: [f32; 16] =
        [0.5, -1.25, 3.0, 2.5, -0.75, 8.0, 1.5, -2.0, 0.25, 7.5, -3.5, 4.0, 6.25, -9.0, 1.0, 0.125];

    fn masks<V: Vector>() {
        for count in 0..V::LANES + 2 {
            let kept = count.min(V::LANES);
            let mut read = [0.0; 16];
            let mut written = [77.0; 16];
            // SAFETY: `on_each` checked the processor. The arrays are as long as the longest
            // vector, and `few` is as long as the mask.
            unsafe {
                let mask = V::mask(count);
                let few = NUMBERS[..kept].to_vec();
                V::load_masked(few.as_ptr(), mask, V::splat(-1.0)).store(read.as_mut_ptr());
                V::load(NUMBERS.as_ptr()).store_masked(written.as_mut_ptr(), mask);
            }
            assert_eq!(read[..kept], NUMBERS[..kept]);
            assert!(read[kept..V::LANES].iter().all(|&value| value == -1.0));
            assert_eq!(written[..kept], NUMBERS[..kept]);
            assert!(written[kept..].iter().all(|&value| value == 77.0));
        }
    }

    #[test]
    fn masks_read_and_write_their_lanes_alone() {
        on_each!(masks);
    }

    fn sums<V: Vector>() {
        let first = &NUMBERS[..V::LANES];
        // SAFETY: see `masks`.
        let (total, greatest) = unsafe {
            let vector = V::load(NUMBERS.as_ptr());
            (vector.total(), vector.greatest())
        };
        // Sums of these numbers are exact.
        assert_eq!(total, first.iter().sum::<f32>());
        assert_eq!(greatest, first.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    }

    #[test]
    fn totals_and_greatest_lanes_are_those_of_all_lanes() {
        on_each!(sums);
    }

    fn arithmetic<V: Vector>() {
        let mut found = [[0.0_f32; 16]; 5];
        // SAFETY: see `masks`.
        unsafe {
            let (a, b) = (V::load(NUMBERS.as_ptr()), V::splat(2.5));
            let results = [a + b, a - b, a * b, a.max(b), a.mul_add(b, a)];
            for (found, result) in found.iter_mut().zip(results) {
                result.store(found.as_mut_ptr());
            }
        }
        for (lane, &a) in NUMBERS.iter().enumerate().take(V::LANES) {
            let expected = [a + 2.5, a - 2.5, a * 2.5, a.max(2.5), a * 2.5 + a];
            assert_eq!(found.map(|result| result[lane]), expected, "lane {lane}");
        }
    }

    #[test]
    fn arithmetic_is_lane_by_lane() {
        on_each!(arithmetic);
    }

    fn powers<V: Vector>() {
        for power in -126_i32..=127 {
            let mut found = [0.0; 16];
            // SAFETY: see `masks`.
            unsafe {
                V::splat(f32::from_bits(power.cast_unsigned()))
                    .power_of_two()
                    .store(found.as_mut_ptr());
            }
            assert!(found[..V::LANES].iter().all(|&value| value == 2f32.powi(power)), "{power}");
        }
    }

    fn halves<V: Vector>() {
        let mut found = [[0.0; 16]; 2];
        // 1.5 in the low half and -0.375 in the high one.
        let pair = f32::from_bits((-0.375_f32).to_bits() | (1.5_f32.to_bits() >> 16));
        // SAFETY: see `masks`.
        unsafe {
            for (found, half) in found.iter_mut().zip(V::splat(pair).halves()) {
                half.store(found.as_mut_ptr());
            }
        }
        assert!(found[0][..V::LANES].iter().all(|&value| value == 1.5));
        assert!(found[1][..V::LANES].iter().all(|&value| value == -0.375));
    }

    #[test]
    fn halves_of_a_lane_are_two_numbers() {
        on_each!(halves);
    }

    fn orders<V: Vector>() {
        let lanes = V::LANES;
        let numbers: Vec<f32> = (0..32).map(|number| number as f32).collect();
        let mut found = [[0.0; 16]; 5];
        // SAFETY: see `masks`. There are as many numbers as lanes of two vectors.
        unsafe {
            let [a, b] = [V::load(numbers.as_ptr()), V::load(numbers[lanes..].as_ptr())];
            let [even, odd] = a.deinterleave(b);
            let [first, second] = even.interleave(odd);
            let results = [even, odd, first, second, a.shifted(b)];
            for (found, result) in found.iter_mut().zip(results) {
                result.store(found.as_mut_ptr());
            }
        }
        let expected = [2, 2, 1, 1, 1].into_iter().zip([0, 1, 0, lanes, 1]);
        for (found, (step, first)) in found.iter().zip(expected) {
            let expected = numbers[first..].iter().step_by(step).take(lanes);
            assert!(found.iter().take(lanes).eq(expected), "{step} {first}: {found:?}");
        }
    }

    #[test]
    fn lanes_are_deinterleaved_interleaved_and_shifted() {
        on_each!(orders);
    }

    #[test]
    fn powers_of_two_are_exact() {
        on_each!(powers);
    }
}
