//! From an instruction set to the kernels that are compiled for it.

use simd::{F32Array, F64Array, InstructionSet};
#[cfg(target_arch = "x86_64")]
use simd::{F32x8, F32x16, F64x4, F64x8};
use spec::Precision;

use crate::DynamicsError;
use crate::block::Block;
use crate::kernels::Kernels;
use crate::replay::Together;
use crate::structure::{Kind, with_structure};

/// Calls a function of [`Kernels`] on the lanes of an instruction set and a precision. The choice never
/// shows in a result, only in the time it takes.
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
    together: &mut Together<'_>,
) {
    with_structure!(kind, |structure| on_lanes!(
        instructions,
        precision,
        replay(structure, together)
    ));
}

/// Robots that are simulated side by side.
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
