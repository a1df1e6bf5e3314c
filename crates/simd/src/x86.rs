//! The part of a hardware lane type that differs only in the names of its intrinsics.

/// Defines lanes over an x86 vector.
///
/// Every `unsafe` block rests on one invariant: values of these types are made and used only by
/// kernels that [`InstructionSet`](crate::InstructionSet) allows, on processors with the
/// instructions.
macro_rules! x86_lanes {
    (
        $(#[$doc:meta])*
        $name:ident($vector:ty) of $scalar:ty, lanes $lanes:literal, double $double:ty,
        features $features:literal,
        trigonometry $trigonometry:expr, exponential $exponential:expr, round $round:expr,
        add $add:ident, sub $sub:ident, mul $mul:ident, div $div:ident,
        mul_add $mul_add:ident, neg_mul_add $neg_mul_add:ident,
        max $max:ident, xor $xor:ident, splat $splat:ident,
        load $load:expr, store $store:expr, turn_by_quadrant $turn:ident, doubled $doubled:ident,
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        #[repr(transparent)]
        pub struct $name($vector);

        impl std::ops::Add for $name {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $add(self.0, other.0) })
            }
        }

        impl std::ops::Sub for $name {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $sub(self.0, other.0) })
            }
        }

        impl std::ops::Mul for $name {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $mul(self.0, other.0) })
            }
        }

        impl std::ops::Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $xor(self.0, $splat(-0.0)) })
            }
        }

        impl $crate::Lanes for $name {
            const LANES: usize = $lanes;
            const TRIGONOMETRY: $crate::Trigonometry = $trigonometry;
            const EXPONENTIAL: $crate::Exponential = $exponential;
            type Double = $double;

            #[inline(always)]
            fn run<K: $crate::Kernel<Self>>(kernel: K) -> K::Output {
                #[target_feature(enable = $features)]
                #[inline(never)]
                fn compiled<K: $crate::Kernel<$name>>(kernel: K) -> K::Output {
                    kernel.run()
                }
                // SAFETY: the processor has the instructions, see the macro.
                unsafe { compiled(kernel) }
            }

            #[inline(always)]
            fn splat(value: f64) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $splat($round(value)) })
            }

            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $mul_add(self.0, b.0, c.0) })
            }

            #[inline(always)]
            fn neg_mul_add(self, b: Self, c: Self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $neg_mul_add(self.0, b.0, c.0) })
            }

            #[inline(always)]
            fn recip(self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $div($splat(1.0), self.0) })
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: the processor has the instruction, see the macro.
                Self(unsafe { $max(self.0, other.0) })
            }

            #[inline(always)]
            fn turn_by_quadrant(quadrant: Self, sin: Self, cos: Self) -> (Self, Self) {
                // SAFETY: the processor has the instructions, see the macro.
                let (sin, cos) = unsafe { $turn(quadrant.0, sin.0, cos.0) };
                (Self(sin), Self(cos))
            }

            #[inline(always)]
            fn doubled(self, power: Self) -> Self {
                // SAFETY: the processor has the instructions, see the macro.
                Self(unsafe { $doubled(self.0, power.0) })
            }

            #[inline(always)]
            fn lane(&self, lane: usize) -> f64 {
                // SAFETY: the vector is an array of this many scalars.
                let lanes = unsafe { &*std::ptr::from_ref(self).cast::<[$scalar; $lanes]>() };
                f64::from(lanes[lane])
            }

            #[inline(always)]
            fn set_lane(&mut self, lane: usize, value: f64) {
                // SAFETY: the vector is an array of this many scalars.
                let lanes = unsafe { &mut *std::ptr::from_mut(self).cast::<[$scalar; $lanes]>() };
                lanes[lane] = $round(value);
            }

            #[inline(always)]
            fn load(values: &[f32; $crate::MAX_LANES]) -> Self {
                // SAFETY: `values` holds at least as many scalars as the vector, see the macro.
                Self(unsafe { $load(values.as_ptr()) })
            }

            #[inline(always)]
            fn store(self, values: &mut [f32; $crate::MAX_LANES]) {
                // SAFETY: `values` holds at least as many scalars as the vector, see the macro.
                unsafe { $store(values.as_mut_ptr(), self.0) }
            }
        }
    };
}

pub(crate) use x86_lanes;
