//! The steps of a search for an exciting motion, and who hears of them.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// Weights of the barrier, one after the other. Each is a maximization that begins where the one
/// before ended.
pub(crate) const BARRIERS: [f64; 5] = [3.0, 1.0, 0.3, 0.1, 0.03];
/// Motions that the first barriers improve, and those of them that go on.
pub(crate) const TRIED: usize = 6;
pub(crate) const TRIED_BARRIERS: usize = 2;
pub(crate) const GOING_ON: usize = 2;
/// Steps for each barrier.
pub(crate) const STEPS: usize = 50;

/// Hears how many steps of a search were done, of which there are at most
/// [`ExcitationSettings::steps`](super::ExcitationSettings::steps). The search ends with
/// [`ExcitationError::Stopped`](super::ExcitationError::Stopped) when it breaks.
pub type ExcitationProgress<'a> = &'a (dyn Fn(u64) -> ControlFlow<()> + Sync);

/// The steps of a search, done on several threads.
pub(crate) struct Steps<'a> {
    progress: ExcitationProgress<'a>,
    stopped: AtomicBool,
}

impl<'a> Steps<'a> {
    /// The most steps of a search that begins with so many random motions.
    pub(crate) const fn most(random_motions: usize) -> u64 {
        let barriers = TRIED * TRIED_BARRIERS + GOING_ON * (BARRIERS.len() - TRIED_BARRIERS);
        (random_motions + barriers * STEPS) as u64
    }

    pub(crate) const fn new(progress: ExcitationProgress<'a>) -> Self {
        Self { progress, stopped: AtomicBool::new(false) }
    }

    pub(crate) fn are_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    pub(crate) fn done(&self, count: u64) {
        if (self.progress)(count).is_break() {
            self.stopped.store(true, Ordering::Relaxed);
        }
    }
}
