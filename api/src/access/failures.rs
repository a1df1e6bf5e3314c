//! Failed logins and wrong tokens: how many an address may send, and which are recorded.

use std::collections::{HashMap, HashSet};
use std::net::IpAddr;
use std::num::NonZero;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use spec::Digest;

/// Number of remembered addresses, and of remembered tokens. Above it, all of them are forgotten.
const REMEMBERED: usize = 10_000;

/// How many times as many failures as one address may have: all addresses together, and all clients
/// without an address of their own.
const ALL: f64 = 10.0;

/// Number of failures that are recorded at once. After that one a minute is recorded, so that nobody
/// can fill the audit log.
const RECORDED_AT_ONCE: f64 = 100.0;
const RECORDED_PER_SECOND: f64 = 1.0 / 60.0;

/// The failures of this server. Clones share them.
#[derive(Clone)]
pub struct FailedLogins {
    per_minute: f64,
    recent: Arc<Mutex<Recent>>,
}

struct Recent {
    all: Bucket,
    recorded: Bucket,
    by_network: HashMap<Option<IpAddr>, Bucket>,
    /// Tokens that were right, with where they came from.
    proven: HashSet<(Option<IpAddr>, Digest)>,
    /// Failures since the last one that was recorded.
    unrecorded: u64,
}

/// A bucket with a hole: failures fill it, and time empties it.
struct Bucket {
    level: f64,
    at: Instant,
}

impl Bucket {
    fn new(now: Instant) -> Self {
        Self { level: 0.0, at: now }
    }

    fn level(&self, now: Instant, per_second: f64) -> f64 {
        let passed = now.saturating_duration_since(self.at).as_secs_f64();
        (self.level - passed * per_second).max(0.0)
    }

    fn add(&mut self, now: Instant, per_second: f64) {
        self.level = self.level(now, per_second) + 1.0;
        self.at = now;
    }

    /// How long until one more failure fits; `None` if it fits now.
    fn wait(&self, now: Instant, per_second: f64, size: f64) -> Option<Duration> {
        let excess = self.level(now, per_second) + 1.0 - size;
        // A thousandth, so that rounding asks nobody to wait for no time.
        (excess > 1e-3).then(|| Duration::from_secs_f64(excess / per_second))
    }
}

impl FailedLogins {
    /// An address may fail so often a minute, and so often at once.
    pub fn new(per_minute: NonZero<u32>) -> Self {
        let now = Instant::now();
        let recent = Recent {
            all: Bucket::new(now),
            recorded: Bucket::new(now),
            by_network: HashMap::new(),
            proven: HashSet::new(),
            unrecorded: 0,
        };
        Self { per_minute: f64::from(per_minute.get()), recent: Arc::new(Mutex::new(recent)) }
    }

    /// How long a client has to wait before it may try to log in; `None` if it may now. While all
    /// addresses together fail too often, those wait that have failed themselves. Clients without an
    /// address of their own count as one, and do not wait for others.
    pub fn wait(&self, network: Option<IpAddr>) -> Option<Duration> {
        self.wait_at(network, Instant::now())
    }

    fn wait_at(&self, network: Option<IpAddr>, now: Instant) -> Option<Duration> {
        let (recent, rate, size) = (self.recent(), self.rate(), self.per_minute);
        let own = recent.by_network.get(&network)?;
        if network.is_none() {
            return own.wait(now, rate * ALL, size * ALL);
        }
        let of_all = recent.all.wait(now, rate * ALL, size * ALL);
        own.wait(now, rate, size).or_else(|| of_all.filter(|_| own.level(now, rate) > 0.0))
    }

    /// Counts a failure. Returns whether it should be recorded, with the number of failures that
    /// were not recorded since the last one.
    pub fn count(&self, network: Option<IpAddr>) -> Option<u64> {
        self.count_at(network, Instant::now())
    }

    fn count_at(&self, network: Option<IpAddr>, now: Instant) -> Option<u64> {
        let rate = self.rate();
        let mut recent = self.recent();
        recent.all.add(now, rate * ALL);
        if recent.by_network.len() >= REMEMBERED {
            recent.by_network.retain(|_, bucket| bucket.level(now, rate) > 0.0);
        }
        if recent.by_network.len() >= REMEMBERED {
            recent.by_network.clear();
        }
        let own = recent.by_network.entry(network).or_insert_with(|| Bucket::new(now));
        own.add(now, if network.is_none() { rate * ALL } else { rate });
        if recent.recorded.wait(now, RECORDED_PER_SECOND, RECORDED_AT_ONCE).is_some() {
            recent.unrecorded += 1;
            return None;
        }
        recent.recorded.add(now, RECORDED_PER_SECOND);
        Some(std::mem::take(&mut recent.unrecorded))
    }

    /// Remembers that a token was right, so that its owner is not kept out by somebody else at the
    /// same address.
    pub fn prove(&self, network: Option<IpAddr>, token: Digest) {
        let mut recent = self.recent();
        if recent.proven.len() >= REMEMBERED {
            recent.proven.clear();
        }
        recent.proven.insert((network, token));
    }

    pub fn is_proven(&self, network: Option<IpAddr>, token: Digest) -> bool {
        self.recent().proven.contains(&(network, token))
    }

    fn rate(&self) -> f64 {
        self.per_minute / 60.0
    }

    fn recent(&self) -> MutexGuard<'_, Recent> {
        // No code panics while it holds the lock.
        self.recent.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ten_a_minute() -> (FailedLogins, Instant) {
        (FailedLogins::new(NonZero::new(10).unwrap()), Instant::now())
    }

    fn address(last: u8) -> Option<IpAddr> {
        Some(IpAddr::from([192, 0, 2, last]))
    }

    #[test]
    fn an_address_that_failed_too_often_waits_and_others_do_not() {
        let (failures, now) = ten_a_minute();
        for _ in 0..10 {
            assert_eq!(failures.wait_at(address(1), now), None);
            failures.count_at(address(1), now);
        }
        let wait = failures.wait_at(address(1), now).unwrap();
        assert!((5.9..=6.1).contains(&wait.as_secs_f64()), "{wait:?}");
        assert_eq!(failures.wait_at(address(2), now), None);
        assert_eq!(failures.wait_at(None, now), None);
        assert_eq!(failures.wait_at(address(1), now + wait), None);
    }

    #[test]
    fn many_addresses_together_keep_out_those_that_failed_and_nobody_else() {
        let (failures, now) = ten_a_minute();
        for last in 0..100 {
            failures.count_at(address(last), now);
        }
        assert!(failures.wait_at(address(1), now).is_some(), "a second failure of one of them");
        assert_eq!(failures.wait_at(None, now), None);
        assert_eq!(failures.wait_at(address(200), now), None);
        assert_eq!(failures.wait_at(address(1), now + Duration::from_secs(2)), None);
    }

    #[test]
    fn clients_without_an_address_of_their_own_count_together() {
        let (failures, now) = ten_a_minute();
        for _ in 0..100 {
            assert_eq!(failures.wait_at(None, now), None);
            failures.count_at(None, now);
        }
        assert!(failures.wait_at(None, now).is_some());
        assert_eq!(failures.wait_at(address(1), now), None);
    }

    #[test]
    fn few_failures_are_recorded_and_the_next_one_says_how_many_were_not() {
        let (failures, now) = ten_a_minute();
        let recorded = (0..5000).filter_map(|_| failures.count_at(address(1), now)).count();
        assert_eq!(recorded, 100);
        let minute = now + Duration::from_secs(61);
        assert_eq!(failures.count_at(address(1), minute), Some(4900));
        assert_eq!(failures.count_at(address(1), minute), None);
    }

    #[test]
    fn a_right_token_is_known_where_it_came_from() {
        let (failures, _) = ten_a_minute();
        let token = Digest::of(b"a token");
        failures.prove(address(1), token);
        assert!(failures.is_proven(address(1), token));
        assert!(!failures.is_proven(address(2), token));
    }
}
