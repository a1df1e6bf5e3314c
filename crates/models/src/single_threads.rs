//! Pools of one thread each, which live as long as the process.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

/// The pools by their place. A pool is made when it is first asked for.
static POOLS: Mutex<Vec<Arc<ThreadPool>>> = Mutex::new(Vec::new());

/// Runs `work` on the thread of `place`, after the work that this thread was given before. Its
/// parallel loops are then plain loops: nothing is divided, and no factor is packed once per thread.
///
/// If the system has no thread to give, `work` runs on the pool of the caller.
pub(crate) fn on_one_thread<T: Send>(place: usize, work: impl FnOnce() -> T + Send) -> T {
    match pool(place) {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

fn pool(place: usize) -> Option<Arc<ThreadPool>> {
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    while pools.len() <= place {
        let index = pools.len();
        let name = move |_| format!("micro-batch-{index}");
        let pool = ThreadPoolBuilder::new().num_threads(1).thread_name(name).build().ok()?;
        pools.push(Arc::new(pool));
    }
    Some(Arc::clone(&pools[place]))
}

#[cfg(test)]
mod tests {
    use super::on_one_thread;

    #[test]
    fn work_runs_on_the_thread_of_its_place() {
        let run = |place| {
            on_one_thread(place, || {
                let name = std::thread::current().name().map(str::to_owned);
                (name.unwrap(), rayon::current_num_threads())
            })
        };
        let named = |name: &str| (name.to_owned(), 1);
        assert_eq!([1, 0, 1].map(run), ["1", "0", "1"].map(|n| named(&format!("micro-batch-{n}"))));
    }

    #[test]
    fn a_panic_reaches_the_caller_and_the_thread_goes_on() {
        let panicking = || on_one_thread(0, || -> () { panic!("a fault") });
        assert!(std::panic::catch_unwind(panicking).is_err());
        assert_eq!(on_one_thread(0, || 7), 7);
    }
}
