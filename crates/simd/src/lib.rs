//! Vectors of floats, and the choice of a processor's instructions.
//!
//! A kernel is written once over a trait and compiled once per type, each time in a function with
//! the `#[target_feature]` of that type. [`InstructionSet`] decides at run time which of them may
//! be called. [`Lanes`] is for arithmetic with the same result on every processor. [`Vector`] is
//! for the fastest loops over floats in memory.
//!
//! The types do not check the processor: their methods use instructions that it must have.
//! Everything is `#[inline(always)]`, because closures and calls do not inline across
//! `#[target_feature]`.

#![warn(missing_docs)]
#![expect(
    clippy::needless_range_loop,
    reason = "closures do not inline into functions compiled for other instructions; loops over indices do"
)]

mod array;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod exponential;
mod instruction_set;
mod lanes;
mod peak;
mod stack;
mod trigonometry;
mod vector;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use array::{F32Array, F64Array};
#[cfg(target_arch = "x86_64")]
pub use avx2::{F32x8, F64x4};
#[cfg(target_arch = "x86_64")]
pub use avx512::{F32x16, F64x8};
pub use exponential::Exponential;
pub use instruction_set::{Detected, InstructionSet, UnknownInstructionSet, VARIABLE};
pub use lanes::{Kernel, Lanes, MAX_LANES};
pub use peak::multiply_adds;
pub use stack::align_stack;
pub use trigonometry::Trigonometry;
pub use vector::{Unfused, Vector};
