//! The heartbeat of an attempt: it renews the lease, sends the log and passes on reasons to stop.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use store::{Fence, Lease, Progress, Store, StoreError};
use tokio_util::sync::CancellationToken;

use crate::attempt_log::AttemptLog;
use crate::stop::{StopReason, StopSignal};

/// Pause between two heartbeats. A cancellation may go unnoticed for this long.
const INTERVAL: Duration = Duration::from_secs(1);

/// How long one heartbeat waits for the database.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);
/// Pause between two lines of the log about progress.
const SAY_EVERY: Duration = Duration::from_secs(60);

/// The progress of an attempt. The work writes it, and the heartbeat reads it.
#[derive(Debug)]
pub struct ProgressCell {
    done: AtomicU64,
    message: Mutex<Option<String>>,
    began: Instant,
    /// Amount of work done by earlier attempts.
    initial: AtomicU64,
    pace: Mutex<Pace>,
}

/// Where the rate of an attempt comes from.
#[derive(Debug)]
enum Pace {
    /// From the work that it has done.
    Measured,
    /// From the work itself, in units per second, if that knows it.
    Told(Option<f64>),
}

impl Default for ProgressCell {
    fn default() -> Self {
        Self {
            done: AtomicU64::new(0),
            message: Mutex::new(None),
            began: Instant::now(),
            initial: AtomicU64::new(0),
            pace: Mutex::new(Pace::Measured),
        }
    }
}

impl ProgressCell {
    pub fn set_done(&self, done: u64) {
        self.done.store(done, Ordering::Relaxed);
    }

    /// Begins with the work that an earlier attempt has done.
    pub fn begin_at(&self, done: u64) {
        self.initial.store(done, Ordering::Relaxed);
        self.set_done(done);
    }

    /// Tells the rate, in units of work per second, of work whose parts take very different times.
    /// `None` if it is not known.
    pub fn expect(&self, rate_per_second: Option<f64>) {
        *self.pace.lock().unwrap_or_else(PoisonError::into_inner) = Pace::Told(rate_per_second);
    }

    /// Seconds since the attempt began.
    pub fn seconds(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    pub fn say(&self, message: String) {
        *self.message.lock().unwrap_or_else(PoisonError::into_inner) = Some(message);
    }

    fn read(&self) -> Progress {
        let done = self.done.load(Ordering::Relaxed);
        let new = done.saturating_sub(self.initial.load(Ordering::Relaxed));
        let seconds = self.seconds();
        #[expect(clippy::cast_precision_loss, reason = "a rate for people to look at")]
        let rate = (new > 0 && seconds > 0.0).then(|| new as f64 / seconds);
        let rate = match *self.pace.lock().unwrap_or_else(PoisonError::into_inner) {
            Pace::Measured => rate,
            Pace::Told(rate) => rate,
        };
        let message = self.message.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Progress { done, rate_per_second: rate, message }
    }
}

/// The duration of an attempt's lease, and the attempt's time limit.
#[derive(Clone, Copy, Debug)]
pub struct LeaseTerms {
    pub fence: Fence,
    /// How long the lease lasts after a renewal.
    pub ttl: Duration,
    pub time_limit: Option<Duration>,
}

/// Renews the lease and sends the log until `over`. Signals the work through `stop` when it has to
/// end.
///
/// It does not stop when the database does not answer: no other worker can claim the task then, and
/// every write carries the epoch of the claim.
pub async fn keep_alive(
    store: &Store,
    lease: LeaseTerms,
    progress: &ProgressCell,
    log: &AttemptLog,
    stop: &StopSignal,
    shutdown: &CancellationToken,
    over: &CancellationToken,
) {
    let LeaseTerms { fence, ttl, time_limit } = lease;
    let began = Instant::now();
    let mut said = began;
    loop {
        tokio::select! {
            () = over.cancelled() => return,
            () = shutdown.cancelled(), if stop.get().is_none() => stop.set(StopReason::Shutdown),
            () = tokio::time::sleep(INTERVAL.min(ttl / 3)) => {}
        }
        if time_limit.is_some_and(|limit| began.elapsed() >= limit) {
            stop.set(StopReason::TimeLimit);
        }
        let progress = progress.read();
        if said.elapsed() >= SAY_EVERY {
            said = Instant::now();
            let Progress { done, rate_per_second, message } = &progress;
            tracing::info!(done, rate_per_second, says = message, "goes on");
        }
        let renewal =
            tokio::time::timeout(ANSWER_WITHIN, async { store.renew(fence, ttl, &progress).await });
        match renewal.await {
            Ok(Ok(Lease::Held { cancel_requested })) => {
                if cancel_requested {
                    stop.set(StopReason::Cancelled);
                }
                match tokio::time::timeout(ANSWER_WITHIN, log.send(store, fence)).await {
                    // The next renewal detects a lost lease.
                    Ok(Ok(()) | Err(StoreError::LeaseLost { .. })) => {}
                    Ok(Err(error)) => {
                        tracing::warn!(error = spec::causes(&error), "cannot write the log");
                    }
                    // The lines are sent again with the next renewal.
                    Err(_) => tracing::warn!("the database does not take the log"),
                }
            }
            Ok(Ok(Lease::Lost)) => {
                stop.set(StopReason::LeaseLost);
                return;
            }
            Ok(Err(error)) => {
                tracing::warn!(task = %fence.task, error = spec::causes(&error), "cannot renew the lease");
            }
            Err(_) => tracing::warn!(task = %fence.task, "the database does not answer"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_that_work_tells_stands_before_the_measured_one() {
        let progress = ProgressCell::default();
        let rate = || progress.read().rate_per_second;
        assert_eq!(rate(), None);
        progress.set_done(1);
        assert!(rate().is_some());
        progress.expect(None);
        assert_eq!(rate(), None);
        progress.expect(Some(2.5));
        assert_eq!(rate(), Some(2.5));
    }
}
