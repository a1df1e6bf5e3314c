//! The processor's peak: the largest rate of multiply-adds.

use std::thread;
use std::time::{Duration, Instant};

use series::median;
use simd::{InstructionSet, multiply_adds};

const MEASURED: Duration = Duration::from_millis(50);
/// Steps of [`multiply_adds`] between two readings of the clock.
const STEPS: u64 = 100_000;
const REPETITIONS: usize = 5;

/// Multiply-adds of f32 per second on `threads` threads at once, with the measured instruction set.
pub(super) fn multiply_adds_per_s(threads: usize) -> f64 {
    let rates = (0..REPETITIONS).map(|_| {
        thread::scope(|scope| {
            let running: Vec<_> = (0..threads).map(|_| scope.spawn(rate)).collect();
            running.into_iter().map(|thread| thread.join().unwrap_or(f64::NAN)).sum()
        })
    });
    median(rates.collect())
}

fn rate() -> f64 {
    let start = Instant::now();
    let mut count = 0;
    while start.elapsed() < MEASURED {
        count += multiply_adds(InstructionSet::best(), STEPS);
    }
    count as f64 / start.elapsed().as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::multiply_adds_per_s;

    #[test]
    fn a_processor_multiplies_and_adds_more_than_once_per_microsecond() {
        assert!(multiply_adds_per_s(1) > 1e6);
    }
}
