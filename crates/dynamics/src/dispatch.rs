//! Selects the simulations that are compiled for an instruction set.

use simd::{F32Array, F64Array, InstructionSet};
#[cfg(target_arch = "x86_64")]
use simd::{F32x8, F32x16, F64x4, F64x8};
use spec::Precision;

use crate::DynamicsError;
use crate::block::{self, Block};
use crate::kernels::Kernels;
use crate::replay::{self, MotionBatch};
use crate::structure::{Kind, Structure, with_structure};

/// Whole simulations. They are compiled once for each lane type and structure.
trait Simulations: Kernels {
    /// See [`block::simulate`].
    fn simulate<S: Structure<N>, const N: usize>(
        structure: S,
        block: &mut Block<'_>,
    ) -> Result<(), DynamicsError>;

    /// See [`replay::replay`].
    fn replay<S: Structure<N>, const N: usize>(structure: S, together: &mut MotionBatch<'_>);
}

macro_rules! simulations {
    ($lanes:ty $(, $features:literal)?) => {
        impl Simulations for $lanes {
            #[inline(always)]
            fn simulate<S: Structure<N>, const N: usize>(
                structure: S,
                block: &mut Block<'_>,
            ) -> Result<(), DynamicsError> {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled<S: Structure<N>, const N: usize>(
                    structure: S,
                    block: &mut Block<'_>,
                ) -> Result<(), DynamicsError> {
                    block::simulate::<$lanes, S, N>(structure, block)
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(structure, block)
                }
            }

            #[inline(always)]
            fn replay<S: Structure<N>, const N: usize>(structure: S, together: &mut MotionBatch<'_>) {
                $(#[target_feature(enable = $features)])?
                #[inline(never)]
                fn compiled<S: Structure<N>, const N: usize>(
                    structure: S,
                    together: &mut MotionBatch<'_>,
                ) {
                    replay::replay::<$lanes, S, N>(structure, together);
                }
                #[allow(unused_unsafe, reason = "array lanes need no instructions of their own")]
                // SAFETY: `InstructionSet` lets only processors with the features come here.
                unsafe {
                    compiled(structure, together)
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
simulations!(F32x16, "avx512f,avx512dq,avx512vl,avx2,fma");
#[cfg(target_arch = "x86_64")]
simulations!(F64x8, "avx512f,avx512dq,avx512vl,avx2,fma");
#[cfg(target_arch = "x86_64")]
simulations!(F32x8, "avx2,fma");
#[cfg(target_arch = "x86_64")]
simulations!(F64x4, "avx2,fma");
simulations!(F32Array<8>);
simulations!(F64Array<4>);

/// Calls a function of [`Simulations`] on the lanes of an instruction set and a precision. The
/// instruction set changes the time, but never the result.
macro_rules! on_lanes {
    ($instructions:expr, $precision:expr, $function:ident($($argument:expr),*)) => {
        match ($instructions, $precision) {
            #[cfg(target_arch = "x86_64")]
            (InstructionSet::Avx512(_), Precision::F32) => F32x16::$function($($argument),*),
            #[cfg(target_arch = "x86_64")]
            (InstructionSet::Avx512(_), Precision::F64) => F64x8::$function($($argument),*),
            #[cfg(target_arch = "x86_64")]
            (InstructionSet::Avx2(_), Precision::F32) => F32x8::$function($($argument),*),
            #[cfg(target_arch = "x86_64")]
            (InstructionSet::Avx2(_), Precision::F64) => F64x4::$function($($argument),*),
            (InstructionSet::Portable, Precision::F32) => F32Array::<8>::$function($($argument),*),
            (InstructionSet::Portable, Precision::F64) => F64Array::<4>::$function($($argument),*),
        }
    };
}

pub(crate) fn simulate(
    instructions: InstructionSet,
    precision: Precision,
    kind: Kind,
    block: &mut Block<'_>,
) -> Result<(), DynamicsError> {
    with_structure!(kind, |structure| on_lanes!(
        instructions,
        precision,
        simulate(structure, block)
    ))
}

pub(crate) fn replay(
    instructions: InstructionSet,
    precision: Precision,
    kind: Kind,
    together: &mut MotionBatch<'_>,
) {
    with_structure!(kind, |structure| on_lanes!(
        instructions,
        precision,
        replay(structure, together)
    ));
}

/// The number of robots that are simulated at once.
pub(crate) fn lanes(instructions: InstructionSet, precision: Precision) -> usize {
    let f64_lanes = match instructions {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512(_) => 8,
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2(_) => 4,
        InstructionSet::Portable => 4,
    };
    match precision {
        Precision::F32 => 2 * f64_lanes,
        Precision::F64 => f64_lanes,
    }
}
