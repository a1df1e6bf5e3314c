//! Detects dead workers by looking at their leases regularly.
//!
//! The wall clock plays no part, because it jumps when it is set and when a machine wakes up. A
//! lease ends when it was not renewed for its whole duration *while somebody looked*. If server and
//! workers slept together, nobody looked, and workers still have their leases when they wake.

use std::collections::HashMap;
use std::time::Duration;

use crate::{Fence, TaskId, Timestamp};

/// The lease of a running task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Leased {
    pub fence: Fence,
    pub worker: String,
    /// Changes with every renewal.
    pub until: Timestamp,
    /// Duration of the lease after a renewal.
    pub lasts: Duration,
    /// Whether `until` has passed by the database's clock.
    pub has_passed: bool,
}

/// All leases at the last look.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    seen: HashMap<TaskId, Seen>,
    has_looked: bool,
}

#[derive(Clone, Copy, Debug)]
struct Seen {
    fence: Fence,
    until: Timestamp,
    /// How long it has been watched without a change.
    unchanged: Duration,
}

/// Two heartbeats. A server that has just started gives a worker with an expired lease this time to
/// renew it.
const GRACE: Duration = Duration::from_secs(2);

impl Watch {
    /// Forgets how long leases have been watched.
    pub fn begin_anew(&mut self) {
        self.seen.clear();
    }

    /// Looks at all leases, `since` after the last look, and returns those that have ended.
    pub fn look(&mut self, leases: Vec<Leased>, since: Duration) -> Vec<Leased> {
        let is_first = !std::mem::replace(&mut self.has_looked, true);
        let before = std::mem::take(&mut self.seen);
        let mut ended = Vec::new();
        for lease in leases {
            let Leased { fence, until, lasts, has_passed, .. } = lease;
            let unchanged = match before.get(&fence.task) {
                Some(seen) if (seen.fence, seen.until) == (fence, until) => seen.unchanged + since,
                None if is_first && has_passed => lasts.saturating_sub(GRACE),
                Some(_) | None => Duration::ZERO,
            };
            self.seen.insert(fence.task, Seen { fence, until, unchanged });
            if unchanged >= lasts {
                ended.push(lease);
            }
        }
        ended
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Epoch;

    const SECOND: Duration = Duration::from_secs(1);

    fn lease(epoch: i64, until: i64) -> Leased {
        Leased {
            fence: Fence { task: TaskId(7), epoch: Epoch(epoch) },
            worker: "w".to_owned(),
            until: Timestamp::from_milliseconds(until),
            lasts: 3 * SECOND,
            has_passed: false,
        }
    }

    /// The number of looks, one second apart, until the lease has ended.
    fn looks_until_ended(watch: &mut Watch, lease: &Leased) -> usize {
        (1..100)
            .find(|_| !watch.look(vec![lease.clone()], SECOND).is_empty())
            .expect("a lease that is never renewed ends")
    }

    #[test]
    fn a_lease_ends_when_it_was_looked_at_as_long_as_it_lasts() {
        assert_eq!(looks_until_ended(&mut Watch::default(), &lease(1, 10)), 4);
    }

    #[test]
    fn a_renewal_and_another_claim_begin_anew() {
        let mut watch = Watch::default();
        for k in 0..50 {
            assert_eq!(watch.look(vec![lease(1, k)], 2 * SECOND), []);
        }
        for epoch in 2..50 {
            assert_eq!(watch.look(vec![lease(epoch, 49)], 2 * SECOND), []);
        }
        assert_eq!(looks_until_ended(&mut watch, &lease(49, 49)), 3);
    }

    /// A clock that was set back an hour makes a renewed lease end earlier than it did.
    #[test]
    fn a_clock_that_is_set_neither_ends_a_lease_nor_keeps_it() {
        let mut watch = Watch::default();
        watch.look(vec![lease(1, 3_600_000)], SECOND);
        assert_eq!(watch.look(vec![lease(1, 1000)], SECOND), []);
        let ahead = Leased { has_passed: true, ..lease(1, 1000) };
        assert_eq!(watch.look(vec![ahead], SECOND), []);
        assert_eq!(looks_until_ended(&mut watch, &lease(1, 1000)), 2);
    }

    #[test]
    fn a_lease_that_ran_out_before_anybody_looked_has_the_grace_of_two_heartbeats() {
        let passed = Leased { lasts: 15 * SECOND, has_passed: true, ..lease(1, 10) };
        assert_eq!(looks_until_ended(&mut Watch::default(), &passed), 3);
        let mut watch = Watch::default();
        watch.look(vec![], SECOND);
        assert_eq!(looks_until_ended(&mut watch, &passed), 16);
    }

    #[test]
    fn after_a_sleep_of_everybody_a_lease_lasts_as_long_as_ever() {
        let mut watch = Watch::default();
        watch.look(vec![lease(1, 10)], SECOND);
        watch.look(vec![lease(1, 10)], 2 * SECOND);
        watch.begin_anew();
        assert_eq!(watch.look(vec![lease(1, 10)], 1000 * SECOND), []);
        assert_eq!(looks_until_ended(&mut watch, &lease(1, 10)), 3);
    }

    #[test]
    fn what_has_ended_is_forgotten() {
        let mut watch = Watch::default();
        watch.look(vec![lease(1, 10)], SECOND);
        watch.look(vec![], SECOND);
        assert!(watch.seen.is_empty());
    }
}
