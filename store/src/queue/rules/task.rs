//! The state of one task, from claim to claim and to its end.

use std::time::Duration;

use wire::TaskState;

use crate::Epoch;

/// Whether a failed task may be tried again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Retry {
    /// While attempts are left.
    Allowed,
    /// No, because it would fail again.
    Never,
}

/// The columns that decide about the next state of a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TaskStanding {
    pub state: TaskState,
    /// Number of claims since the task last made progress. Claims that were released do not count.
    pub attempt: u32,
    pub max_attempts: u32,
    pub epoch: Epoch,
    pub cancel_requested: bool,
}

/// How a worker gives a task back. An expired lease is a failure that may be retried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    Completed,
    Failed(Retry),
    /// The worker shuts down.
    Released,
    /// There is no room for the results, which has nothing to do with the task.
    Deferred,
    /// The worker noticed that the task is to be cancelled.
    Stopped,
}

impl TaskStanding {
    /// A claim counts as an attempt at once, so a task that kills its workers comes to an end. It
    /// raises the epoch, so the worker that had the task before can no longer write.
    #[must_use]
    pub fn claimed(self) -> Self {
        let epoch = Epoch(self.epoch.0 + 1);
        Self { state: TaskState::Running, attempt: self.attempt + 1, epoch, ..self }
    }

    /// The task has saved something that the next attempt need not repeat, such as a checkpoint.
    /// This attempt becomes the first of those that count.
    #[must_use]
    pub fn with_saved_progress(self) -> Self {
        Self { attempt: self.attempt.min(1), ..self }
    }

    /// Whether the worker that claimed the task at `epoch` may still write: the fence.
    pub fn is_held_at(&self, epoch: Epoch) -> bool {
        self.state == TaskState::Running && self.epoch == epoch
    }

    /// The next state of a running task, and how long it cannot be claimed if it is queued again.
    #[must_use]
    pub fn after(self, ending: Ending) -> (Self, Duration) {
        let ended = |state| (Self { state, ..self }, Duration::ZERO);
        match ending {
            Ending::Completed => ended(TaskState::Succeeded),
            Ending::Failed(Retry::Never) => ended(TaskState::Failed),
            Ending::Stopped => ended(TaskState::Cancelled),
            Ending::Failed(Retry::Allowed) | Ending::Released | Ending::Deferred
                if self.cancel_requested =>
            {
                ended(TaskState::Cancelled)
            }
            Ending::Failed(Retry::Allowed) if self.attempt >= self.max_attempts => {
                ended(TaskState::Failed)
            }
            Ending::Failed(Retry::Allowed) => {
                (Self { state: TaskState::Queued, ..self }, delay_after(self.attempt))
            }
            Ending::Released => {
                let attempt = self.attempt.saturating_sub(1);
                (Self { state: TaskState::Queued, attempt, ..self }, Duration::ZERO)
            }
            Ending::Deferred => {
                let attempt = self.attempt.saturating_sub(1);
                let uncounted = self.epoch.0.saturating_sub(i64::from(attempt));
                let delay = deferral_after(u32::try_from(uncounted).unwrap_or(u32::MAX));
                (Self { state: TaskState::Queued, attempt, ..self }, delay)
            }
        }
    }
}

const FIRST_DELAY: Duration = Duration::from_secs(5);
/// The longest delay before a retry.
pub(crate) const LONGEST_DELAY: Duration = Duration::from_secs(300);

/// The delay before a retry. There is none after the first attempt, because most deaths have
/// nothing to do with the task. After that it doubles each time.
fn delay_after(attempt: u32) -> Duration {
    let Some(doublings) = attempt.checked_sub(2) else { return Duration::ZERO };
    FIRST_DELAY.saturating_mul(2u32.saturating_pow(doublings)).min(LONGEST_DELAY)
}

/// The delay after a claim that does not count, given the number of such claims. Other tasks, which
/// may need less room, have their turn meanwhile.
fn deferral_after(uncounted: u32) -> Duration {
    let doublings = uncounted.saturating_sub(1);
    FIRST_DEFERRAL.saturating_mul(2u32.saturating_pow(doublings)).min(LONGEST_DELAY)
}

const FIRST_DEFERRAL: Duration = Duration::from_secs(15);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_without_room_waits_ever_longer_and_never_fails() {
        let mut standing = TaskStanding {
            state: TaskState::Queued,
            attempt: 0,
            max_attempts: 1,
            epoch: Epoch(0),
            cancel_requested: false,
        };
        let delays = (0..7).map(|_| {
            let (next, delay) = standing.claimed().after(Ending::Deferred);
            standing = next;
            assert_eq!((next.state, next.attempt), (TaskState::Queued, 0));
            delay.as_secs()
        });
        assert_eq!(delays.collect::<Vec<_>>(), [15, 30, 60, 120, 240, 300, 300]);
        let cancelled = TaskStanding { cancel_requested: true, ..standing.claimed() };
        assert_eq!(cancelled.after(Ending::Deferred).0.state, TaskState::Cancelled);
    }

    #[test]
    fn retries_come_at_once_and_then_ever_later_up_to_a_limit() {
        let seconds: Vec<u64> = (1..=5).map(|attempt| delay_after(attempt).as_secs()).collect();
        assert_eq!(seconds, [0, 5, 10, 20, 40]);
        assert_eq!(delay_after(20), LONGEST_DELAY);
    }

    /// The state of a task after each attempt, if each of its workers dies.
    fn dies(gets_on: impl Fn(u32) -> bool) -> Vec<TaskState> {
        let queued = TaskStanding {
            state: TaskState::Queued,
            attempt: 0,
            max_attempts: 3,
            epoch: Epoch(0),
            cancel_requested: false,
        };
        let attempts = (1..=10).scan(queued, |standing, attempt| {
            if standing.state != TaskState::Queued {
                return None;
            }
            let claimed = standing.claimed();
            let claimed = if gets_on(attempt) { claimed.with_saved_progress() } else { claimed };
            *standing = claimed.after(Ending::Failed(Retry::Allowed)).0;
            Some(standing.state)
        });
        attempts.collect()
    }

    #[test]
    fn attempts_that_got_on_do_not_count() {
        use TaskState::{Failed, Queued};
        assert_eq!(dies(|_| false), [Queued, Queued, Failed]);
        assert_eq!(dies(|_| true), [Queued; 10]);
        assert_eq!(dies(|attempt| attempt <= 4), [Queued, Queued, Queued, Queued, Queued, Failed]);
    }
}
