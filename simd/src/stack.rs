use std::hint::black_box;
use std::mem::MaybeUninit;

/// As long and as aligned as the longest vector.
#[repr(align(64))]
struct Line;

/// Aligns the stack of the function that calls this to a line of the cache.
///
/// Vectors that find no register go to the stack. The compiler leaves it at 16 bytes there, whatever the vectors
/// are, so that every other one of 32 bytes and every one of 64 lies across two lines, and takes twice as long to
/// store and to load. Something aligned in the same function makes it align all of them. For functions with
/// hundreds of vectors; those that have enough registers gain nothing.
#[inline(always)]
pub fn align_stack() {
    black_box(&mut MaybeUninit::<Line>::uninit());
}
