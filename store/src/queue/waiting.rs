//! Waiting for a task without polling the database.

use std::hash::{BuildHasher, RandomState};
use std::time::{Duration, Instant};

use crate::boxed;
use crate::database::Ringing;
use crate::{Store, StoreError};

/// Rings when tasks were queued.
///
/// All waiting workers hear it, and few of them get a task. A worker that heard it in vain lets
/// others go first the next time, for a random moment, so that they do not all ask the database at
/// once. With more workers, each hears it in vain more often, and the moments grow. One of them
/// still asks within a few milliseconds, however many there are.
#[derive(Debug)]
pub struct Bell {
    inner: Ringing,
    /// Rings since the last one that brought a task.
    in_vain: u32,
    /// When it last rang or brought a task, or when it was created.
    heard_at: Instant,
}

/// Pause between two looks for tasks that did not ring, because they may be claimed only from a
/// moment on.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// The same pause after [`QUIET_AFTER`] without anything to do. Many idle workers look at different
/// moments.
const LOOK_EVERY_WHEN_QUIET: Duration = Duration::from_secs(10);

const QUIET_AFTER: Duration = Duration::from_secs(10);

/// How much longer a worker lets others go first after each further ring in vain.
const BACKOFF_STEP: Duration = Duration::from_millis(4);

/// The longest time for which a worker lets others go first.
const LONGEST_BACKOFF: Duration = Duration::from_millis(400);

impl Store {
    /// A bell for tasks that are queued from now on. With PostgreSQL a bell is a connection, so
    /// drop it while working.
    ///
    /// # Errors
    /// When the database does not answer.
    #[boxed]
    pub async fn bell(&self) -> Result<Bell, StoreError> {
        let inner = self.database().bell().await?;
        Ok(Bell { inner, in_vain: 0, heard_at: Instant::now() })
    }
}

impl Bell {
    /// Waits until it rings, or for `longest`. A task that may be claimed only from a moment on
    /// does not ring.
    ///
    /// # Errors
    /// When the database does not answer. Make another bell then.
    #[boxed]
    pub async fn wait(&mut self, longest: Duration) -> Result<(), StoreError> {
        if self.inner.wait(longest).await? {
            self.heard_at = Instant::now();
            let backoff = backoff(self.in_vain, RandomState::new().hash_one(()));
            self.in_vain = self.in_vain.saturating_add(1);
            tokio::time::sleep(backoff).await;
        }
        Ok(())
    }

    /// How long to wait for a ring before looking without one.
    pub fn patience(&self) -> Duration {
        if self.heard_at.elapsed() < QUIET_AFTER { LOOK_EVERY } else { LOOK_EVERY_WHEN_QUIET }
    }

    /// Records that a task was found. The backoff starts again at zero.
    pub fn task_found(&mut self) {
        self.in_vain = 0;
        self.heard_at = Instant::now();
    }
}

/// How long to wait after this many rings in vain, so that other workers go first. `chance` is a
/// random number.
fn backoff(in_vain: u32, chance: u64) -> Duration {
    let longest = BACKOFF_STEP.saturating_mul(in_vain).min(LONGEST_BACKOFF);
    let nanoseconds = u64::try_from(longest.as_nanos()).unwrap_or(u64::MAX);
    Duration::from_nanos(chance % nanoseconds.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_gets_every_task_goes_at_once() {
        assert_eq!(backoff(0, u64::MAX), Duration::ZERO);
    }

    #[test]
    fn whoever_hears_many_rings_in_vain_lets_others_go_first_but_not_for_long() {
        let latest = |in_vain| (0..1000).map(|i| backoff(in_vain, i * 7_919_777)).max().unwrap();
        assert!(latest(2) < 2 * BACKOFF_STEP);
        assert!(latest(2) > BACKOFF_STEP);
        assert!(latest(u32::MAX) < LONGEST_BACKOFF);
        assert!(latest(u32::MAX) > LONGEST_BACKOFF / 10 * 9);
    }
}
