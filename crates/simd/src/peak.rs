//! The fastest multiply-adds of a processor.

use std::hint::black_box;

use crate::{F32Array, InstructionSet, Lanes};
#[cfg(target_arch = "x86_64")]
use crate::{F32x8, F32x16};

/// Independent chains: more than the units of any processor need, and no more than the registers of
/// AVX2.
const CHAINS: usize = 12;

/// Performs `steps` multiply-adds of f32 in each lane of twelve vectors that stay in registers, and
/// gives their number. This is the most that a core can do in the time.
pub fn multiply_adds(instructions: InstructionSet, steps: u64) -> u64 {
    let lanes = match instructions {
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx512(_) => {
            // SAFETY: a value of this variant exists only where the processor has these instructions.
            unsafe { avx512(steps) };
            F32x16::LANES
        }
        #[cfg(target_arch = "x86_64")]
        InstructionSet::Avx2(_) => {
            // SAFETY: see above.
            unsafe { avx2(steps) };
            <F32x8 as Lanes>::LANES
        }
        InstructionSet::Portable => {
            chains::<F32Array<8>>(steps);
            F32Array::<8>::LANES
        }
    };
    steps * (CHAINS * lanes) as u64
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
fn avx512(steps: u64) {
    chains::<F32x16>(steps);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2(steps: u64) {
    chains::<F32x8>(steps);
}

#[inline(always)]
fn chains<L: Lanes>(steps: u64) {
    let (factor, addend) = (L::splat(black_box(0.5)), L::splat(black_box(1.0)));
    let mut values = [factor; CHAINS];
    for _ in 0..steps {
        for chain in 0..CHAINS {
            values[chain] = values[chain].mul_add(factor, addend);
        }
    }
    let mut sum = values[0];
    for chain in 1..CHAINS {
        sum = sum + values[chain];
    }
    black_box(sum.lane(0));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_lane_of_every_chain_counts() {
        for instructions in InstructionSet::available() {
            let count = multiply_adds(instructions, 10);
            assert!(count == 10 * 12 * 8 || count == 10 * 12 * 16, "{instructions}: {count}");
        }
    }
}
