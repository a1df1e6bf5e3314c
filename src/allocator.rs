//! The allocator of the program, of which training asks more than most.

use std::ffi::{c_int, c_long};

use mimalloc::MiMalloc;

/// Training allocates and frees the same large tensors at every step; glibc gives such pages back
/// to the system each time and doubles the time of a step.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// `mi_option_purge_delay` of `mimalloc.h`, which the allocator's bindings do not name.
const PURGE_DELAY: c_int = 15;

/// How long freed memory is kept, ms. By default a second, after which a step finds its memory
/// gone: a tenth of its time went into getting it back.
const KEPT_MS: c_long = 60_000;

unsafe extern "C" {
    fn mi_option_set(option: c_int, value: c_long);
}

/// Keeps memory that was freed for the next step or prediction, for a minute.
pub fn keep_freed_memory() {
    // SAFETY: mimalloc, which is linked as the allocator above, sets a number of its own.
    unsafe { mi_option_set(PURGE_DELAY, KEPT_MS) };
}

#[cfg(test)]
mod tests {
    use super::{KEPT_MS, PURGE_DELAY, keep_freed_memory};
    use std::ffi::{c_int, c_long};

    unsafe extern "C" {
        fn mi_option_get(option: c_int) -> c_long;
    }

    /// Would fail if another version of mimalloc numbered its options otherwise.
    #[test]
    fn what_is_set_is_the_delay_of_a_second_that_mimalloc_begins_with() {
        // SAFETY: mimalloc reads a number of its own.
        let delay = || unsafe { mi_option_get(PURGE_DELAY) };
        assert_eq!(delay(), 1000);
        keep_freed_memory();
        assert_eq!(delay(), KEPT_MS);
    }
}
