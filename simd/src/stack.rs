use std::hint::black_box;
use std::mem::MaybeUninit;

/// A type with the size and the alignment of the longest vector.
#[repr(align(64))]
struct Line;

/// Aligns the stack of the calling function to a cache line.
///
/// Vectors without a register go to the stack. The compiler aligns it to 16 bytes, whatever the
/// vectors are. So every second vector of 32 bytes, and every one of 64, spans two lines, which
/// slows loads and stores. An aligned local in the same function makes the compiler align all of
/// them. Functions with hundreds of vectors become faster. Those with enough registers do not.
#[inline(always)]
pub fn align_stack() {
    black_box(&mut MaybeUninit::<Line>::uninit());
}
