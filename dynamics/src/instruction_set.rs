use std::fmt;

use spec::Precision;

use crate::DynamicsError;
use crate::block::Block;
use crate::lanes::{F32Array, F64Array, Kernels};
#[cfg(target_arch = "x86_64")]
use crate::lanes::{F32x8, F32x16, F64x4, F64x8};
use crate::replay::Together;

/// The vector instructions a simulation uses. A value exists only where the processor has them.
///
/// The choice never shows in a result, only in the time it takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstructionSet(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    Portable,
}

impl InstructionSet {
    /// Those this processor has, the fastest first. The last one needs nothing special.
    pub fn available() -> Vec<Self> {
        #[allow(unused_mut, reason = "other processors have nothing to add")]
        let mut available = Vec::with_capacity(3);
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if avx2 && avx512 {
                available.push(Self(Kind::Avx512));
            }
            if avx2 {
                available.push(Self(Kind::Avx2));
            }
        }
        available.push(Self(Kind::Portable));
        available
    }

    /// The fastest this processor has.
    pub fn best() -> Self {
        Self::available()[0]
    }

    /// Robots that are simulated side by side.
    pub fn lanes(self, precision: Precision) -> usize {
        let f64_lanes = match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => 8,
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => 4,
            Kind::Portable => 4,
        };
        match precision {
            Precision::F32 => 2 * f64_lanes,
            Precision::F64 => f64_lanes,
        }
    }

    pub(crate) fn simulate(
        self,
        precision: Precision,
        block: &mut Block<'_>,
    ) -> Result<(), DynamicsError> {
        match (self.0, precision) {
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx512, Precision::F32) => F32x16::simulate(block),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx512, Precision::F64) => F64x8::simulate(block),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx2, Precision::F32) => F32x8::simulate(block),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx2, Precision::F64) => F64x4::simulate(block),
            (Kind::Portable, Precision::F32) => F32Array::<8>::simulate(block),
            (Kind::Portable, Precision::F64) => F64Array::<4>::simulate(block),
        }
    }

    pub(crate) fn replay(self, precision: Precision, together: &mut Together<'_>) {
        match (self.0, precision) {
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx512, Precision::F32) => F32x16::replay(together),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx512, Precision::F64) => F64x8::replay(together),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx2, Precision::F32) => F32x8::replay(together),
            #[cfg(target_arch = "x86_64")]
            (Kind::Avx2, Precision::F64) => F64x4::replay(together),
            (Kind::Portable, Precision::F32) => F32Array::<8>::replay(together),
            (Kind::Portable, Precision::F64) => F64Array::<4>::replay(together),
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "AVX-512",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "AVX2",
            Kind::Portable => "portable",
        })
    }
}
