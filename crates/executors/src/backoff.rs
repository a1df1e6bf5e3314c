//! Backoff: pauses that grow while something fails.

use std::time::Duration;

/// The pause before the next try.
#[derive(Clone, Debug)]
pub struct Backoff {
    first: Duration,
    longest: Duration,
    next: Duration,
}

impl Backoff {
    pub const fn new(first: Duration, longest: Duration) -> Self {
        Self { first, longest, next: first }
    }

    /// Resets to the first pause.
    pub const fn reset(&mut self) {
        self.next = self.first;
    }

    /// The pause after another failure: twice as long as the one before, up to a limit.
    pub fn fail(&mut self) -> Duration {
        let pause = self.next;
        self.next = (pause * 2).min(self.longest);
        pause
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_a_limit_and_begin_anew() {
        let mut backoff = Backoff::new(Duration::from_secs(5), Duration::from_secs(30));
        let pauses: Vec<u64> = (0..5).map(|_| backoff.fail().as_secs()).collect();
        assert_eq!(pauses, [5, 10, 20, 30, 30]);
        backoff.reset();
        assert_eq!(backoff.fail(), Duration::from_secs(5));
    }
}
