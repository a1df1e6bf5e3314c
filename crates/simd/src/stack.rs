//! The alignment of the stack.

use std::hint::black_box;
use std::mem::MaybeUninit;

/// A type with the size and the alignment of the longest vector.
#[repr(align(64))]
struct Line;

/// Aligns the stack of the calling function to a cache line.
///
/// Vectors that have no register go to the stack. The compiler aligns the stack to 16 bytes for
/// vectors of any size. So every second vector of 32 bytes, and every vector of 64 bytes, spans two
/// cache lines, which slows loads and stores. An aligned local variable makes the compiler align
/// all vectors of the function. Functions with hundreds of vectors become faster. Functions with
/// enough registers do not.
#[inline(always)]
pub fn align_stack() {
    black_box(&mut MaybeUninit::<Line>::uninit());
}
