use std::hint::black_box;
use std::mem::MaybeUninit;

/// As long and as aligned as the longest vector.
#[repr(align(64))]
struct Line;

/// Aligns the stack of the function that calls this to a line of the cache.
///
/// Vectors that find no register go to the stack. The compiler leaves it at 16 bytes there, whatever the vectors
/// are, so that every other one of 32 bytes and every one of 64 lies across two lines, which slows loads and stores.
/// An aligned local in the same function makes the compiler align all of them. Functions with hundreds of vectors
/// gain; those that have enough registers do not.
#[inline(always)]
pub fn align_stack() {
    black_box(&mut MaybeUninit::<Line>::uninit());
}
