//! Computations whose parallel loops follow each other within microseconds.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rayon::Yield;

/// How long the others are waited for before the work begins without them.
const GATHERING: Duration = Duration::from_micros(100);

/// Runs `work` on a thread of the pool, the others of which stay awake meanwhile.
///
/// A step of training has hundreds of parallel loops, and between them moments with work for one thread
/// alone. In such a moment the others fall asleep, and to wake them takes longer than many a loop. Here
/// they look for work until all of it is done; while there is none they give their core to
/// whoever else wants it.
pub(crate) fn keep_vigil<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let vigil = Vigil::default();
    let others = rayon::current_num_threads().saturating_sub(1);
    rayon::scope(|scope| {
        for _ in 0..others {
            scope.spawn(|_| vigil.keep());
        }
        let begin = Instant::now();
        while vigil.awake.load(Ordering::Acquire) < others && begin.elapsed() < GATHERING {
            std::hint::spin_loop();
        }
        vigil.has_begun.store(true, Ordering::Release);
        let _end = End(&vigil);
        work()
    })
}

#[derive(Default)]
struct Vigil {
    awake: AtomicUsize,
    has_begun: AtomicBool,
    is_over: AtomicBool,
}

impl Vigil {
    /// Until the end, on a thread that was idle at the beginning. A thread that comes to it later does
    /// so while it waits for a part of the work, which would wait for the end.
    fn keep(&self) {
        if self.has_begun.load(Ordering::Acquire) {
            return;
        }
        self.awake.fetch_add(1, Ordering::AcqRel);
        while !self.is_over.load(Ordering::Acquire) {
            if rayon::yield_now() != Some(Yield::Executed) {
                thread::yield_now();
            }
        }
    }
}

/// Ends the vigil, also when the work panics.
struct End<'a>(&'a Vigil);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.is_over.store(true, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use rayon::prelude::*;

    use super::keep_vigil;

    fn sum(count: u64) -> u64 {
        keep_vigil(|| (0..count).into_par_iter().map(|number| (0..number % 50).sum::<u64>()).sum())
    }

    #[test]
    fn work_ends_on_any_number_of_threads_and_within_itself() {
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let expected: u64 = (0..1000_u64).map(|number| (0..number % 50).sum::<u64>()).sum();
            pool.install(|| {
                for _ in 0..50 {
                    assert_eq!(sum(1000), expected);
                }
                let many: Vec<u64> = (0..40).into_par_iter().map(|_| sum(1000)).collect();
                assert_eq!(many, vec![expected; 40]);
                assert_eq!(keep_vigil(|| sum(1000)), expected);
            });
        }
    }

    #[test]
    fn a_panic_ends_it() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        pool.install(|| {
            let caught = catch_unwind(AssertUnwindSafe(|| keep_vigil(|| panic!("as asked"))));
            assert!(caught.is_err());
            assert_eq!(sum(10), 120);
        });
    }
}
