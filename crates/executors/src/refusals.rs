//! Workers that the engine refused to place. Workers with other offers are requested meanwhile.

use std::time::{Duration, Instant};

use spec::Resources;

use crate::backoff::Backoff;

/// The refused offers. They are not requested again before a pause is over.
#[derive(Debug)]
pub struct Refusals {
    first: Duration,
    longest: Duration,
    known: Vec<Refusal>,
}

#[derive(Debug)]
struct Refusal {
    offer: Resources,
    why: String,
    pauses: Backoff,
    until: Instant,
}

impl Refusals {
    /// Pauses grow from `first` to `longest`.
    pub const fn new(first: Duration, longest: Duration) -> Self {
        Self { first, longest, known: Vec::new() }
    }

    /// Whether a worker with this offer should not be requested now.
    pub fn hold(&self, offer: &Resources, now: Instant) -> bool {
        self.known.iter().any(|refusal| refusal.offer == *offer && now < refusal.until)
    }

    /// Adds a refusal of this offer.
    pub fn add(&mut self, offer: &Resources, why: String, now: Instant) {
        match self.known.iter_mut().find(|refusal| refusal.offer == *offer) {
            Some(refusal) => {
                refusal.why = why;
                refusal.until = now + refusal.pauses.fail();
            }
            None => {
                let mut pauses = Backoff::new(self.first, self.longest);
                let until = now + pauses.fail();
                self.known.push(Refusal { offer: offer.clone(), why, pauses, until });
            }
        }
    }

    /// Removes an offer, because the engine placed a worker with it after all.
    pub fn end(&mut self, offer: &Resources) {
        self.known.retain(|refusal| refusal.offer != *offer);
    }

    /// Forgets offers that no task needs any more.
    pub fn keep(&mut self, is_wanted: impl Fn(&Resources) -> bool) {
        self.known.retain(|refusal| is_wanted(&refusal.offer));
    }

    /// The latest reason for a refusal.
    pub fn why(&self) -> Option<&str> {
        self.known.last().map(|refusal| refusal.why.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offer_that_was_refused_waits_for_longer_each_time_and_others_do_not() {
        let (small, large) = (Resources::default(), Resources { gpus: 9, ..Resources::default() });
        let second = Duration::from_secs(1);
        let mut refusals = Refusals::new(second, 3 * second);
        let mut now = Instant::now();
        for pause in [1, 2, 3, 3] {
            refusals.add(&large, format!("no node has it ({pause})"), now);
            assert!(refusals.hold(&large, now) && !refusals.hold(&small, now));
            now += pause * second;
            assert!(!refusals.hold(&large, now), "{pause} s");
        }
        assert_eq!(refusals.why(), Some("no node has it (3)"));
        refusals.keep(|offer| *offer == large);
        assert!(refusals.why().is_some());
        refusals.end(&large);
        assert_eq!(refusals.why(), None);
    }
}
