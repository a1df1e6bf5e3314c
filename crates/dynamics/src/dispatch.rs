//! Selects the simulations that are compiled for an instruction set.

use simd::{InstructionSet, Kernel, Lanes, align_stack, with_f32_lanes, with_f64_lanes};
use spec::Precision;

use crate::DynamicsError;
use crate::block::{self, Block};
use crate::closed_loop;
use crate::replay::{self, MotionBatch};
use crate::structure::{Kind, Structure, with_structure};

/// Runs a kernel on the lanes of an instruction set and a precision. The instruction set changes the
/// time, but never the result.
macro_rules! run {
    ($instructions:expr, $precision:expr, $kernel:expr) => {
        match $precision {
            Precision::F32 => with_f32_lanes!($instructions, L => L::run($kernel)),
            Precision::F64 => with_f64_lanes!($instructions, L => L::run($kernel)),
        }
    };
}

/// See [`block::simulate`].
struct Simulate<'a, 'b, S, const N: usize> {
    structure: S,
    block: &'a mut Block<'b>,
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for Simulate<'_, '_, S, N> {
    type Output = Result<(), DynamicsError>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        block::simulate::<L, S, N>(self.structure, self.block)
    }
}

pub(crate) fn simulate(
    instructions: InstructionSet,
    precision: Precision,
    kind: Kind,
    block: &mut Block<'_>,
) -> Result<(), DynamicsError> {
    with_structure!(kind, |structure| run!(instructions, precision, Simulate { structure, block }))
}

/// See [`closed_loop::simulate`].
struct SimulateClosedLoop<'a, 'b, S, const N: usize> {
    structure: S,
    block: &'a mut Block<'b>,
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for SimulateClosedLoop<'_, '_, S, N> {
    type Output = Result<(), DynamicsError>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        align_stack();
        closed_loop::simulate::<L, S, N>(self.structure, self.block)
    }
}

pub(crate) fn simulate_closed_loop(
    instructions: InstructionSet,
    precision: Precision,
    kind: Kind,
    block: &mut Block<'_>,
) -> Result<(), DynamicsError> {
    with_structure!(kind, |structure| run!(
        instructions,
        precision,
        SimulateClosedLoop { structure, block }
    ))
}

/// See [`replay::replay`].
struct Replay<'a, 'b, S, const N: usize> {
    structure: S,
    batch: &'a mut MotionBatch<'b>,
}

impl<L: Lanes, S: Structure<N>, const N: usize> Kernel<L> for Replay<'_, '_, S, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        replay::replay::<L, S, N>(self.structure, self.batch);
    }
}

pub(crate) fn replay(
    instructions: InstructionSet,
    precision: Precision,
    kind: Kind,
    batch: &mut MotionBatch<'_>,
) {
    with_structure!(kind, |structure| run!(instructions, precision, Replay { structure, batch }));
}

/// The number of robots that are simulated at once.
pub(crate) fn lanes(instructions: InstructionSet, precision: Precision) -> usize {
    match precision {
        Precision::F32 => with_f32_lanes!(instructions, L => L::LANES),
        Precision::F64 => with_f64_lanes!(instructions, L => L::LANES),
    }
}
