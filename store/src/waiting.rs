//! Waiting for a task without asking all the time.

use std::hash::{BuildHasher, RandomState};
use std::time::{Duration, Instant};

use crate::boxed;
use crate::database::Database;
use crate::{Store, StoreError, postgres, sqlite};

/// Rings when tasks were queued.
///
/// All who wait hear it, and few of them get a task. Whoever heard it in vain lets others go first the next time, for a
/// moment by chance, so that many do not ask the database all at once. The more who wait, the more often each hears it in
/// vain, and the longer the moments: someone goes within a few milliseconds, however many there are.
#[derive(Debug)]
pub struct Bell {
    inner: Inner,
    /// Rings since the last that brought a task.
    in_vain: u32,
    /// When it rang or brought a task, or was hung up.
    heard_at: Instant,
}

/// Between two looks for a task that rang for nobody: one that may be claimed from a moment on.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// The same after [`QUIET_AFTER`] without anything to do. Many idle workers look at different moments.
const LOOK_EVERY_WHEN_QUIET: Duration = Duration::from_secs(10);

const QUIET_AFTER: Duration = Duration::from_secs(10);

/// How much longer others may go first after one more ring in vain.
const COURTESY: Duration = Duration::from_millis(4);

/// The longest that anybody lets others go first.
const LONGEST_COURTESY: Duration = Duration::from_millis(400);

#[derive(Debug)]
enum Inner {
    Sqlite(sqlite::Bell),
    Postgres(postgres::Bell),
}

impl Store {
    /// Tasks that are queued from now on ring. With PostgreSQL a bell is a connection: drop it while work lasts.
    ///
    /// # Errors
    /// When the database does not answer.
    #[boxed]
    pub async fn bell(&self) -> Result<Bell, StoreError> {
        const OPERATION: &str = "listening for tasks";
        let inner = match self.database() {
            Database::Sqlite(database) => Inner::Sqlite(database.bell()),
            Database::Postgres(database) => {
                let bell = database.bell().await.map_err(StoreError::database(OPERATION))?;
                Inner::Postgres(bell)
            }
        };
        Ok(Bell { inner, in_vain: 0, heard_at: Instant::now() })
    }
}

impl Bell {
    /// Returns when it rings, and after `longest` at the latest: a task that may be claimed from a moment on rings for nobody.
    ///
    /// # Errors
    /// When the database does not answer; make another bell then.
    #[boxed]
    pub async fn wait(&mut self, longest: Duration) -> Result<(), StoreError> {
        let rang = match &mut self.inner {
            Inner::Sqlite(bell) => bell.wait(longest).await,
            Inner::Postgres(bell) => {
                bell.wait(longest).await.map_err(StoreError::database("waiting for a task"))?
            }
        };
        if rang {
            self.heard_at = Instant::now();
            let courtesy = courtesy(self.in_vain, RandomState::new().hash_one(()));
            self.in_vain = self.in_vain.saturating_add(1);
            tokio::time::sleep(courtesy).await;
        }
        Ok(())
    }

    /// How long to wait for a ring before looking without one.
    pub fn patience(&self) -> Duration {
        if self.heard_at.elapsed() < QUIET_AFTER { LOOK_EVERY } else { LOOK_EVERY_WHEN_QUIET }
    }

    /// A task was found.
    pub fn brought_a_task(&mut self) {
        self.in_vain = 0;
        self.heard_at = Instant::now();
    }
}

/// How long to let others go first after so many rings in vain; `chance` is any number.
fn courtesy(in_vain: u32, chance: u64) -> Duration {
    let longest = COURTESY.saturating_mul(in_vain).min(LONGEST_COURTESY);
    let nanoseconds = u64::try_from(longest.as_nanos()).unwrap_or(u64::MAX);
    Duration::from_nanos(chance % nanoseconds.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_gets_every_task_goes_at_once() {
        assert_eq!(courtesy(0, u64::MAX), Duration::ZERO);
    }

    #[test]
    fn whoever_hears_many_rings_in_vain_lets_others_go_first_but_not_for_long() {
        let latest = |in_vain| (0..1000).map(|i| courtesy(in_vain, i * 7_919_777)).max().unwrap();
        assert!(latest(2) < 2 * COURTESY);
        assert!(latest(2) > COURTESY);
        assert!(latest(u32::MAX) < LONGEST_COURTESY);
        assert!(latest(u32::MAX) > LONGEST_COURTESY / 10 * 9);
    }
}
