use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Progress per second over the last half minute, as observed by this client.
#[derive(Debug, Default)]
pub struct Rate {
    seen: VecDeque<(Instant, u64)>,
}

const WINDOW: Duration = Duration::from_secs(30);

impl Rate {
    /// Records `done` at `now`. Returns the rate as soon as there is progress.
    pub fn observe(&mut self, done: u64, now: Instant) -> Option<f64> {
        // Work that was lost with a killed worker is done again, so the measurement begins anew.
        if self.seen.back().is_some_and(|(_, before)| done < *before) {
            self.seen.clear();
        }
        self.seen.push_back((now, done));
        while self.seen.front().is_some_and(|(at, _)| now.duration_since(*at) > WINDOW) {
            self.seen.pop_front();
        }
        let (since, before) = *self.seen.front()?;
        let seconds = now.duration_since(since).as_secs_f64();
        if seconds > 0.0 && done > before { Some((done - before) as f64 / seconds) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_done_again_after_a_kill_gives_no_negative_rate() {
        let mut rate = Rate::default();
        let start = Instant::now();
        assert_eq!(rate.observe(100, start), None);
        assert_eq!(rate.observe(200, start + Duration::from_secs(10)), Some(10.0));
        assert_eq!(rate.observe(150, start + Duration::from_secs(11)), None);
        assert_eq!(rate.observe(155, start + Duration::from_secs(12)), Some(5.0));
    }
}
