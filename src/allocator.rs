//! The program's memory allocator, which matters most for training.

use std::ffi::{c_int, c_long};

use mimalloc::MiMalloc;

/// Training allocates and frees the same large tensors at every step. glibc returns such pages to
/// the system each time, which doubles the time of a step.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// `mi_option_purge_delay` of `mimalloc.h`. The allocator's bindings do not have it.
const PURGE_DELAY: c_int = 15;

/// How long freed memory is kept, ms. By default it is a second, so a step found its memory gone
/// and spent a tenth of its time getting it back.
const KEPT_MS: c_long = 60_000;

unsafe extern "C" {
    fn mi_option_set(option: c_int, value: c_long);
}

/// Keeps freed memory for a minute, for the next step or prediction.
pub fn keep_freed_memory() {
    // SAFETY: mimalloc is linked as the allocator above, and sets a number of its own.
    unsafe { mi_option_set(PURGE_DELAY, KEPT_MS) };
}

#[cfg(test)]
mod tests {
    use super::{KEPT_MS, PURGE_DELAY, keep_freed_memory};
    use std::ffi::{c_int, c_long};

    unsafe extern "C" {
        fn mi_option_get(option: c_int) -> c_long;
    }

    /// Fails if another version of mimalloc numbers its options differently.
    #[test]
    fn what_is_set_is_the_delay_of_a_second_that_mimalloc_begins_with() {
        // SAFETY: mimalloc reads a number of its own.
        let delay = || unsafe { mi_option_get(PURGE_DELAY) };
        assert_eq!(delay(), 1000);
        keep_freed_memory();
        assert_eq!(delay(), KEPT_MS);
    }
}
