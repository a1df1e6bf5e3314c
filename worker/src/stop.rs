use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use models::Interrupt;
use tokio::sync::watch;
use tokio::time::Instant;

/// Why an attempt is to end before it is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The worker is to end; another will go on.
    Shutdown,
    /// It takes longer than its job allows.
    TimeLimit,
    /// Its user asked for the job to end.
    Cancelled,
    /// Somebody else has the task: nothing may be written any more.
    LeaseLost,
}

impl StopReason {
    /// How long the work may take to end when it is told to, before the worker ends without it. A checkpoint of a large
    /// model takes seconds, and schedulers of clusters give 30 s between a warning and the end.
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

/// A reason to stop, set by the heartbeat and looked at by the work. The gravest reason stays.
#[derive(Debug, Default)]
pub struct StopSignal {
    reason: AtomicU8,
    interrupt: Interrupt,
    /// When the work should have ended: the earliest of the moments that its reasons give.
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

    /// Raised with any reason: ends what a model computes.
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

    /// Returns when the work should have ended, never unless it is told to.
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
                // The sender is this signal's own and never gone.
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
        // Every heartbeat says it again, which gives no more time.
        stop.set(StopReason::TimeLimit);
        assert!(left().unwrap() <= of_time_limit);
        stop.set(StopReason::Cancelled);
        assert!(left().unwrap() <= StopReason::Cancelled.within());
    }
}
