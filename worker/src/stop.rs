//! Reasons to stop an attempt, and the signal that carries them to the work.

use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use models::Interrupt;
use tokio::sync::watch;
use tokio::time::Instant;

/// Why an attempt has to end before its work is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The worker has to end. Another one will continue.
    Shutdown,
    /// The attempt exceeds the time limit of its job.
    TimeLimit,
    /// A user cancelled the job.
    Cancelled,
    /// Another worker has the task, so nothing may be written any more.
    LeaseLost,
}

impl StopReason {
    /// How long the work may take to end after it is told to. Then the worker ends without it. A
    /// checkpoint of a large model takes seconds, and schedulers of clusters give 30 s between a
    /// warning and the end.
    pub const fn within(self) -> Duration {
        match self {
            Self::Shutdown => Duration::from_secs(20),
            Self::TimeLimit => Duration::from_secs(30),
            Self::Cancelled | Self::LeaseLost => Duration::from_secs(10),
        }
    }

    /// Completes "the task is to end: ...".
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Shutdown => "its worker was told to stop",
            Self::TimeLimit => "it takes longer than its job allows",
            Self::Cancelled => "its job was cancelled",
            Self::LeaseLost => "its lease is lost",
        }
    }
}

/// A reason to stop, which the heartbeat sets and the work checks. The most serious reason stays.
#[derive(Debug, Default)]
pub struct StopSignal {
    reason: AtomicU8,
    interrupt: Interrupt,
    /// The moment by which the work must end: the earliest that its reasons give.
    deadline: watch::Sender<Option<Instant>>,
}

impl StopSignal {
    pub fn set(&self, reason: StopReason) {
        let code = match reason {
            StopReason::Shutdown => 1,
            StopReason::TimeLimit => 2,
            StopReason::Cancelled => 3,
            StopReason::LeaseLost => 4,
        };
        let before = self.reason.fetch_max(code, Ordering::Relaxed);
        if before < code {
            tracing::warn!("the task is to end: {}", reason.as_str());
            let deadline = Instant::now() + reason.within();
            self.deadline.send_modify(|earliest| {
                *earliest = Some(earliest.map_or(deadline, |earliest| earliest.min(deadline)));
            });
        }
        self.interrupt.raise();
    }

    /// An interrupt that any reason raises. It ends the computations of a model.
    pub fn interrupt(&self) -> &Interrupt {
        &self.interrupt
    }

    pub fn get(&self) -> Option<StopReason> {
        match self.reason.load(Ordering::Relaxed) {
            0 => None,
            1 => Some(StopReason::Shutdown),
            2 => Some(StopReason::TimeLimit),
            3 => Some(StopReason::Cancelled),
            _ => Some(StopReason::LeaseLost),
        }
    }

    /// Waits until the work should have ended. Never returns if it was not told to end.
    pub async fn overdue(&self) {
        let mut deadline = self.deadline.subscribe();
        loop {
            let by = *deadline.borrow_and_update();
            let passed = async {
                match by {
                    Some(by) => tokio::time::sleep_until(by).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = passed => return,
                // The sender belongs to this signal and is never gone.
                _ = deadline.changed() => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_lease_outweighs_every_other_reason() {
        let stop = StopSignal::default();
        assert_eq!((stop.get(), stop.interrupt().is_raised()), (None, false));
        for reason in [StopReason::LeaseLost, StopReason::Shutdown, StopReason::Cancelled] {
            stop.set(reason);
        }
        assert_eq!(stop.get(), Some(StopReason::LeaseLost));
        assert!(stop.interrupt().is_raised());
    }

    #[test]
    fn work_has_as_long_as_its_strictest_reason_gives() {
        let stop = StopSignal::default();
        let left = || (*stop.deadline.borrow()).map(|by| by.duration_since(Instant::now()));
        assert_eq!(left(), None);
        stop.set(StopReason::TimeLimit);
        let of_time_limit = left().unwrap();
        assert!(of_time_limit > StopReason::Cancelled.within(), "{of_time_limit:?}");
        // Every heartbeat repeats this, which does not extend the time.
        stop.set(StopReason::TimeLimit);
        assert!(left().unwrap() <= of_time_limit);
        stop.set(StopReason::Cancelled);
        assert!(left().unwrap() <= StopReason::Cancelled.within());
    }
}
