use std::sync::atomic::{AtomicU8, Ordering};

use models::Interrupt;

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

/// A reason to stop, set by the heartbeat and looked at by the work. The gravest reason stays.
#[derive(Debug, Default)]
pub struct StopSignal {
    reason: AtomicU8,
    interrupt: Interrupt,
}

impl StopSignal {
    pub fn set(&self, reason: StopReason) {
        let code = match reason {
            StopReason::Shutdown => 1,
            StopReason::TimeLimit => 2,
            StopReason::Cancelled => 3,
            StopReason::LeaseLost => 4,
        };
        self.reason.fetch_max(code, Ordering::Relaxed);
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
}
